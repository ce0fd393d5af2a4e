"""The folder that recordings and captured sessions lie in: the server makes every name, and nothing outside is ever touched."""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from prismstereo_hw.errors import DataError, UsageError

__all__ = ["Record", "Records"]

RecordKind = Literal["recording", "session"]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,95}")
_INSIDE = re.compile(r"(?:stills/[0-9]{6}|video/[0-9]{6}|background/(?:video|still))\.png")
_MOST_LISTED = 500
_TRIES = 100


@dataclass(frozen=True, slots=True)
class Record:
    """One recording or session: its name in the folder, the bytes of a recording, when it was changed."""

    name: str
    kind: RecordKind
    bytes: int
    changed_s: float


@dataclass(frozen=True, slots=True)
class Records:
    """The folder; it is made when the first thing is put into it."""

    folder: Path

    def listed(self) -> list[Record]:
        """Give what lies there, the newest first; what is a link, or no record, is left out."""
        found: list[Record] = []
        try:
            entries = list(os.scandir(self.folder))
        except OSError:
            return []
        for entry in entries:
            kind = self._kind(entry.name)
            if kind is not None:
                about = entry.stat(follow_symlinks=False)
                found.append(Record(entry.name, kind, about.st_size, about.st_mtime))
        return sorted(found, key=lambda record: record.changed_s, reverse=True)[:_MOST_LISTED]

    def recording(self, name: str) -> Path:
        """Give the path of a recording by its name; `UsageError` for anything that is not one in this folder."""
        if self._kind(name) != "recording":
            raise UsageError(f"there is no recording {name[:80]!r} here: choose one of the list")
        return self.folder / name

    def picture(self, name: str, inside: str) -> Path:
        """Give the path of a picture of a captured session; `UsageError` for anything else."""
        path = self.folder / name / inside
        known = self._kind(name) == "session" and _INSIDE.fullmatch(inside) is not None
        if not known or path.parent.is_symlink() or path.is_symlink() or not path.is_file():
            raise UsageError(f"there is no picture {name[:80]!r} {inside[:40]!r} here")
        return path

    def pictures(self, record: Record) -> list[str]:
        """Give the places of a session's stills and its background in its folder; none for a recording."""
        if record.kind != "session":
            return []
        folder = self.folder / record.name
        found = [*sorted((folder / "stills").glob("*.png"))[:_MOST_LISTED], folder / "background" / "still.png"]
        return [path.relative_to(folder).as_posix() for path in found if path.is_file()]

    def new_session(self) -> Path:
        """Make a new, empty folder for a session, named after the time; `DataError` where that cannot be."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for number in range(_TRIES):
                path = self.folder / f"{time.strftime('%Y%m%d-%H%M%S')}{f'-{number}' if number else ''}-session"
                try:
                    path.mkdir()
                except FileExistsError:
                    continue
                return path
        except OSError as error:
            raise DataError(
                f"cannot write to {self.folder}: {error.strerror}: give another folder with --records"
            ) from error
        raise DataError(f"{self.folder} has {_TRIES} sessions of this second: wait for the next one")

    def _kind(self, name: str) -> RecordKind | None:
        if not _NAME.fullmatch(name):
            return None
        path = self.folder / name
        if path.is_symlink():
            return None
        if name.endswith(".mcap") and path.is_file():
            return "recording"
        return "session" if (path / "session.toml").is_file() else None
