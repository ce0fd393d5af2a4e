"""How a bundle is made, by whoever holds the private key: never on a camera, never in a build."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from prismstereo_device.update.bundle import Header
from prismstereo_device.update.version import Version
from prismstereo_device.wire import LIMITS
from prismstereo_hw.errors import UsageError

__all__ = ["write_bundle"]


def write_bundle(payload: Path, private_key: Path, bundle: Path, *, product: str, version: str) -> None:
    """Sign a payload file with an Ed25519 private key (PEM file, not encrypted) and write the bundle.

    `DataError` for a version of another form, `UsageError` for a file that cannot be read, a key that is none, a payload that
    is empty or too large, and a product that is no name.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    Version.parse(version)
    try:
        key = load_pem_private_key(_read(private_key), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise UsageError(
            f"{private_key} is no private key: make one with `openssl genpkey -algorithm ed25519`"
        ) from error
    if not isinstance(key, Ed25519PrivateKey):
        raise UsageError(f"{private_key} holds another kind of key: an Ed25519 private key is needed")
    content = _read(payload)
    if not 0 < len(content) <= LIMITS.object:
        raise UsageError(f"{payload} has {len(content)} bytes: an update has 1 to {LIMITS.object}")
    header = Header(product, version, len(content), hashlib.sha256(content).hexdigest())
    try:
        msgspec.convert(msgspec.to_builtins(header), Header)
    except msgspec.ValidationError as error:
        raise UsageError(f"product {product!r}, version {version!r}: no camera would take them ({error})") from error
    signed = header.pack()
    bundle.write_bytes(signed + key.sign(signed) + content)


def _read(path: Path) -> bytes:
    """Read a file, and of one that is too large only so much that this can be told."""
    try:
        with path.open("rb") as file:
            return file.read(LIMITS.object + 1)
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from error
