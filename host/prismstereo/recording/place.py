"""Where recordings are kept: one folder, names of our own making, nothing outside of it."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from prismstereo.recording.errors import RecordingError
from prismstereo.recording.output import FileOutput
from prismstereo_hw.errors import UsageError

__all__ = ["RecordingFolder"]

_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,58}\.mcap")
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
_SAME_SECOND = 100


class RecordingFolder:
    """A folder of recordings, made if need be. Names from outside are checked: `UsageError` for what is not one of ours."""

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(f"cannot make the folder {root}: {error.strerror}: give another one") from error

    def create(self, device_id: bytes, when: datetime | None = None) -> tuple[Path, FileOutput]:
        """Make a new file, `YYYYmmdd-HHMMSS-deviceid.mcap` in UTC; never one that is there already."""
        stamp = (when or datetime.now(UTC)).astimezone(UTC).strftime("%Y%m%d-%H%M%S")
        for number in range(1, _SAME_SECOND):
            again = f"-{number}" if number > 1 else ""
            path = self.root / f"{stamp}-{device_id.hex()}{again}.mcap"
            if not path.exists() and not path.is_symlink():
                return path, FileOutput(path)
        raise RecordingError(
            f"{self.root} holds {_SAME_SECOND - 1} recordings of this very second: wait for the next one"
        )

    def names(self) -> list[str]:
        """Name the recordings that are here, oldest first; links are none."""
        return sorted(
            path.name
            for path in self.root.iterdir()
            if _NAME.fullmatch(path.name) and path.is_file() and not path.is_symlink()
        )

    def path(self, name: str) -> Path:
        """Take a name to its file in this folder, and nowhere else; `UsageError` where it is not the name of one here."""
        if not _NAME.fullmatch(name) or _RESERVED.fullmatch(name):
            raise UsageError(
                f"{name[:80]!r} is no name of a recording: letters, digits, '.', '_' and '-', ending in .mcap"
            )
        path = self.root / name
        if path.is_symlink() or not path.is_file() or path.resolve().parent != self.root.resolve():
            raise UsageError(f"there is no recording {name} in {self.root}: {len(self.names())} others are there")
        return path
