"""The file under a recording: bytes are appended, made safe, and cut off again where a write failed."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Protocol

from prismstereo.recording.errors import RecordingError

__all__ = ["FileOutput", "Output"]

_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class Output(Protocol):
    """Where a recording goes. Every call may raise OSError; after that the bytes appended last may be there in part."""

    def append(self, data: bytes) -> None:
        """Add bytes at the end."""

    def cut(self, size: int) -> None:
        """Keep the first `size` bytes only; the next ones follow them."""

    def sync(self) -> None:
        """Return when everything appended so far outlives a power cut."""

    def space(self) -> tuple[int, int]:
        """Give the bytes that are free where this is kept, and how many there are in all."""
        ...

    def close(self) -> None:
        """Give the file back; closing twice does no harm."""


class FileOutput:
    """A new file; what is there already, link or file, is never touched: RecordingError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor = -1
        try:
            self._descriptor = os.open(path, _FLAGS | getattr(os, "O_CLOEXEC", 0), 0o644)
            _sync_folder(path.parent)
        except OSError as error:
            self.close()
            raise RecordingError(
                f"cannot write {path}: {error.strerror}: give a name that is not taken, in a folder that can be written to"
            ) from error

    def append(self, data: bytes) -> None:
        """Add bytes at the end."""
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._descriptor, rest) :]

    def cut(self, size: int) -> None:
        """Keep the first `size` bytes only."""
        os.ftruncate(self._descriptor, size)
        os.lseek(self._descriptor, size, os.SEEK_SET)

    def sync(self) -> None:
        """Return when the disk has it."""
        os.fsync(self._descriptor)

    def space(self) -> tuple[int, int]:
        """Give free and all bytes of the file's disk."""
        usage = shutil.disk_usage(self._path.parent)
        return usage.free, usage.total

    def close(self) -> None:
        """Give the file back."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def _sync_folder(folder: Path) -> None:
    """Make the file's name outlive a power cut; a system that cannot open folders does that by itself."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
