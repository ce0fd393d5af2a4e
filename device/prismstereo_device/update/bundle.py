r"""An update bundle: one file that says what it is, and proves who says so.

    offset  bytes
    0       4       magic "PSU\n"
    4       2       length of the header, little-endian, at most 1024
    6       n       header: canonical JSON {"product","version","size","sha256"}, in this order, no spaces
    6+n     64      Ed25519 signature of everything before
    70+n    size    payload: what the system's own updater takes (a RAUC or SWUpdate bundle)

The signature is verified before a field is believed, the payload is hashed in pieces, and nothing is written here.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, BinaryIO

import msgspec

from prismstereo_device.update.version import Version
from prismstereo_device.wire import LIMITS
from prismstereo_hw.errors import DataError, UsageError

__all__ = ["KEY_BYTES", "MAGIC", "PREFIX", "SIGNATURE_BYTES", "Bundle", "Header", "check", "read_public_key"]

MAGIC = b"PSU\n"
PREFIX = struct.Struct("<4sH")
SIGNATURE_BYTES = 64
KEY_BYTES = 32
_MOST_HEADER_BYTES = 1024
_READ_BYTES = 1 << 20
_MOST_KEY_FILE_BYTES = 4096


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the signature vouches for."""

    product: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}\Z")]
    version: Annotated[str, msgspec.Meta(max_length=40)]
    size: Annotated[int, msgspec.Meta(ge=1, le=LIMITS.object)]
    sha256: Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]

    def pack(self) -> bytes:
        """Give magic, length and header: the bytes that are signed."""
        text = msgspec.json.encode(self)
        return PREFIX.pack(MAGIC, len(text)) + text


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle that was found good: its payload is `size` bytes from `payload_offset` of its file, to the end."""

    product: str
    version: Version
    version_text: str
    size: int
    sha256: bytes
    payload_offset: int


def check(
    source: Path | BinaryIO,
    public_key: bytes,
    *,
    product: str,
    installed_version: str,
    allow_downgrade: bool = False,
) -> Bundle:
    """Read a bundle through, and describe it if it is signed by the key's owner, meant for this product, and not older.

    `public_key` has 32 bytes. `DataError` says why a bundle is refused; a file that cannot be read raises `OSError`.
    """
    if isinstance(source, Path):
        with source.open("rb") as file:
            return check(
                file,
                public_key,
                product=product,
                installed_version=installed_version,
                allow_downgrade=allow_downgrade,
            )
    header, offset = _signed_header(source, public_key)
    version = Version.parse(header.version)
    if header.product != product:
        raise DataError(f"the bundle is for {header.product!r}, and this camera is a {product!r}: take the right one")
    if version < Version.parse(installed_version) and not allow_downgrade:
        raise DataError(
            f"the bundle has version {header.version}, older than the installed {installed_version}: "
            "an older one is taken only where the camera's configuration allows it"
        )
    _require_payload(source, header)
    return Bundle(header.product, version, header.version, header.size, bytes.fromhex(header.sha256), offset)


def read_public_key(path: Path) -> bytes:
    """Read the 32 bytes of an Ed25519 public key from a PEM file; `UsageError` when it is none."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    try:
        with path.open("rb") as file:
            key = load_pem_public_key(file.read(_MOST_KEY_FILE_BYTES))
    except OSError as error:
        raise UsageError(f"cannot read the update key {path}: {error.strerror}") from error
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UsageError(f"{path} is no public key in PEM form: make one with `openssl pkey -pubout`") from error
    if not isinstance(key, Ed25519PublicKey):
        raise UsageError(f"{path} holds another kind of key: an Ed25519 public key is needed")
    return key.public_bytes_raw()


def _signed_header(file: BinaryIO, public_key: bytes) -> tuple[Header, int]:
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    prefix = _exactly(file, PREFIX.size)
    magic, length = PREFIX.unpack(prefix)
    if magic != MAGIC:
        raise DataError(f"the file begins with {magic!r}, not with {MAGIC!r}: it is no update bundle")
    if not 0 < length <= _MOST_HEADER_BYTES:
        raise DataError(f"the bundle's header has {length} bytes: it has 1 to {_MOST_HEADER_BYTES}")
    text = _exactly(file, length)
    signature = _exactly(file, SIGNATURE_BYTES)
    try:
        Ed25519PublicKey.from_public_bytes(public_key).verify(signature, prefix + text)
    except InvalidSignature as error:
        raise DataError("the bundle is not signed by the owner of this camera's update key: refused") from error
    try:
        header = msgspec.json.decode(text, type=Header)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise DataError(f"the bundle's header cannot be read ({error}): make the bundle again") from error
    if header.pack() != prefix + text:
        raise DataError("the bundle's header is not in canonical form: make the bundle again")
    return header, PREFIX.size + length + SIGNATURE_BYTES


def _require_payload(file: BinaryIO, header: Header) -> None:
    digest, rest = hashlib.sha256(), header.size
    while rest and (block := file.read(min(rest, _READ_BYTES))):
        digest.update(block)
        rest -= len(block)
    if rest:
        raise DataError(f"{rest} of the payload's {header.size} bytes are missing: the bundle was cut")
    if file.read(1):
        raise DataError(f"there is more behind the payload's {header.size} bytes: the bundle was damaged")
    if digest.hexdigest() != header.sha256:
        raise DataError("the payload does not have the sha256 that was signed: the bundle was damaged")


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) < size:
        raise DataError(f"the bundle ends after {len(data)} of {size} bytes of its head: it was cut")
    return data
