"""Where a good bundle waits for the system's updater: `update/bundle`, and `update/ready` that says so.

`ready` is written last and taken away first, so whoever sees it finds the whole bundle it describes. It has one `name=value`
a line: product, version, size and sha256 (hex) of the payload, and offset, where the payload begins in the bundle.
"""

from __future__ import annotations

import contextlib

from prismstereo_device.state.disk import Disk
from prismstereo_device.update.bundle import Bundle, check
from prismstereo_hw.errors import DataError

__all__ = ["UpdateInbox"]

_FOLDER = "update"
_BUNDLE, _READY, _READY_NEW = f"{_FOLDER}/bundle", f"{_FOLDER}/ready", f"{_FOLDER}/ready.new"


class UpdateInbox:
    """Takes bundles that are signed with the owner of `public_key` (32 bytes), for this product and not older."""

    def __init__(
        self, disk: Disk, public_key: bytes, *, product: str, installed_version: str, allow_downgrade: bool = False
    ) -> None:
        self._disk = disk
        self._public_key = public_key
        self._product, self._installed_version = product, installed_version
        self._allow_downgrade = allow_downgrade

    def take(self, name: str) -> str | None:
        """Check a staged file and move it here; give why not where it is refused, and then nothing has changed.

        `OSError` when the disk fails: what waited before still waits, or nothing does.
        """
        try:
            bundle = self._check(name)
        except DataError as error:
            return str(error)
        self._disk.sync(name)
        if _READY in self._disk.names(_FOLDER):
            self._disk.remove(_READY)
            self._disk.sync_folder(_FOLDER)
        self._disk.rename(name, _BUNDLE)
        self._disk.sync_folder(_FOLDER)
        self._disk.write(_READY_NEW, _described(bundle))
        self._disk.sync(_READY_NEW)
        self._disk.rename(_READY_NEW, _READY)
        self._disk.sync_folder(_FOLDER)
        return None

    def waiting(self) -> Bundle | None:
        """Describe the bundle that waits, checked again; None where none does, or it is not the one `ready` describes."""
        with contextlib.suppress(OSError, DataError):
            said = self._disk.read(_READY)
            bundle = self._check(_BUNDLE)
            return bundle if said == _described(bundle) else None
        return None

    def _check(self, name: str) -> Bundle:
        with self._disk.open(name) as file:
            return check(
                file,
                self._public_key,
                product=self._product,
                installed_version=self._installed_version,
                allow_downgrade=self._allow_downgrade,
            )


def _described(bundle: Bundle) -> bytes:
    lines = [
        f"product={bundle.product}",
        f"version={bundle.version_text}",
        f"size={bundle.size}",
        f"sha256={bundle.sha256.hex()}",
        f"offset={bundle.payload_offset}",
    ]
    return "".join(f"{line}\n" for line in lines).encode()
