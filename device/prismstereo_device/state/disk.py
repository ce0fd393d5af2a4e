"""The disk as the state sees it: a folder with few files, and no promise but what is synced.

A name is `file` or `folder/file`, the folder one of `FOLDERS`. What was written is there for good only after `sync` of the
file and, where its name is new or another, `sync_folder` of its folder; a power cut leaves of everything else as much as it
likes. Every call raises `OSError` as the operating system does. All state goes through here, so that a test can take the
power away at any call.
"""

from __future__ import annotations

import errno
import io
import os
import re
import shutil
from pathlib import Path
from typing import BinaryIO, Protocol

from prismstereo_hw.errors import DeviceError, UsageError

__all__ = ["FOLDERS", "Disk", "MemoryDisk", "RealDisk", "StorageError", "require_name"]

FOLDERS = ("staging", "update")

_NAME = re.compile(rf"(?:(?:{'|'.join(FOLDERS)})/)?[a-z0-9][a-z0-9._-]{{0,63}}")
_FOLDER_MODE, _FILE_MODE = 0o700, 0o600
_MEMORY_BYTES = 4 << 20


class StorageError(DeviceError):
    """Storage that is full or broken, or that does not give back what was written."""


class Disk(Protocol):
    """A folder's files by name."""

    @property
    def persistent(self) -> bool:
        """Whether what is synced outlives this process."""
        ...

    def names(self, folder: str = "") -> list[str]:
        """List the names of a folder's files, as the other calls take them."""
        ...

    def size(self, name: str) -> int:
        """Tell how many bytes a file has."""
        ...

    def read(self, name: str) -> bytes:
        """Give a file's bytes."""
        ...

    def open(self, name: str) -> BinaryIO:
        """Open a file to be read from its beginning; the caller closes it."""
        ...

    def write(self, name: str, data: bytes) -> None:
        """Make a file hold these bytes and no others; not safe from a power cut before it is synced, and not whole either."""
        ...

    def write_at(self, name: str, offset: int, data: bytes) -> None:
        """Put bytes into a file that is there, at an offset."""
        ...

    def sync(self, name: str) -> None:
        """Return once a file's bytes are safe."""
        ...

    def sync_folder(self, folder: str = "") -> None:
        """Return once the names in a folder are safe."""
        ...

    def rename(self, old: str, new: str) -> None:
        """Give a file another name, in one step; what had that name is gone."""
        ...

    def remove(self, name: str) -> None:
        """Take a file away."""
        ...

    def free(self) -> int:
        """Tell how many bytes there is room for."""
        ...


def require_name(name: str) -> str:
    """Refuse a name that could lead out of the folder; `UsageError`."""
    if _NAME.fullmatch(name) is None:
        raise UsageError(
            f"{name!r} is no name of a state file: give small letters, digits, '.', '_' and '-', at most 64"
        )
    return name


class RealDisk:
    """A folder of the file system, readable by its owner alone; made with its subfolders if it is not there.

    No link is followed below the folder. `StorageError` when the folder cannot be made.
    """

    persistent = True

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            for path in (folder, *(folder / name for name in FOLDERS)):
                path.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
            self.sync_folder()
        except OSError as error:
            raise StorageError(
                f"the state folder {folder} cannot be used: {error.strerror}; give a writable one"
            ) from error

    def names(self, folder: str = "") -> list[str]:
        """List the names of a folder's files."""
        at = self._enter(folder)
        try:
            with os.scandir(at) as entries:
                found = [f"{folder}/{entry.name}" if folder else entry.name for entry in entries if not entry.is_dir()]
            return sorted(found)
        finally:
            os.close(at)

    def size(self, name: str) -> int:
        """Tell how many bytes a file has."""
        with self._opened(name, os.O_RDONLY) as file:
            return os.fstat(file.fileno()).st_size

    def read(self, name: str) -> bytes:
        """Give a file's bytes."""
        with self._opened(name, os.O_RDONLY) as file:
            return file.read()

    def open(self, name: str) -> BinaryIO:
        """Open a file to be read from its beginning."""
        return io.BufferedReader(self._opened(name, os.O_RDONLY))

    def write(self, name: str, data: bytes) -> None:
        """Make a file hold these bytes and no others."""
        with self._opened(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC) as file:
            _write_all(file, 0, data)

    def write_at(self, name: str, offset: int, data: bytes) -> None:
        """Put bytes into a file at an offset."""
        with self._opened(name, os.O_WRONLY) as file:
            _write_all(file, offset, data)

    def sync(self, name: str) -> None:
        """Return once a file's bytes are safe, and let the next read fetch them from the medium."""
        with self._opened(name, os.O_RDONLY) as file:
            os.fsync(file.fileno())
            if hasattr(os, "posix_fadvise"):
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)

    def sync_folder(self, folder: str = "") -> None:
        """Return once the names in a folder are safe."""
        at = self._enter(folder)
        try:
            os.fsync(at)
        finally:
            os.close(at)

    def rename(self, old: str, new: str) -> None:
        """Give a file another name, in one step."""
        os.replace(self._folder / require_name(old), self._folder / require_name(new))

    def remove(self, name: str) -> None:
        """Take a file away."""
        (self._folder / require_name(name)).unlink()

    def free(self) -> int:
        """Tell how many bytes of the file system are left."""
        return shutil.disk_usage(self._folder).free

    def _enter(self, folder: str) -> int:
        if folder and folder not in FOLDERS:
            raise UsageError(f"{folder!r} is no folder of the state: {', '.join(FOLDERS)} are")
        path = self._folder / folder if folder else self._folder
        return os.open(path, os.O_RDONLY | os.O_DIRECTORY | (os.O_NOFOLLOW if folder else 0))

    def _opened(self, name: str, flags: int) -> io.FileIO:
        folder, _, file = require_name(name).rpartition("/")
        at = self._enter(folder)
        try:
            number = os.open(file, flags | os.O_NOFOLLOW | os.O_CLOEXEC, _FILE_MODE, dir_fd=at)
        finally:
            os.close(at)
        return io.FileIO(number, "w" if flags & os.O_WRONLY else "r")


def _write_all(file: io.FileIO, offset: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        written = os.pwrite(file.fileno(), rest, offset)
        offset, rest = offset + written, rest[written:]


class MemoryDisk:
    """Files that go with the process, for a camera without a state folder; has room for a few calibrations."""

    persistent = False

    def __init__(self, room: int = _MEMORY_BYTES) -> None:
        self._room = room
        self._files: dict[str, bytearray] = {}

    def names(self, folder: str = "") -> list[str]:
        """List the names of a folder's files."""
        return sorted(name for name in self._files if name.rpartition("/")[0] == folder)

    def size(self, name: str) -> int:
        """Tell how many bytes a file has."""
        return len(self._file(name))

    def read(self, name: str) -> bytes:
        """Give a file's bytes."""
        return bytes(self._file(name))

    def open(self, name: str) -> BinaryIO:
        """Open a file to be read from its beginning."""
        return io.BytesIO(self._file(name))

    def write(self, name: str, data: bytes) -> None:
        """Make a file hold these bytes and no others."""
        self._files[require_name(name)] = bytearray()
        self.write_at(name, 0, data)

    def write_at(self, name: str, offset: int, data: bytes) -> None:
        """Put bytes into a file at an offset."""
        file = self._file(name)
        grown = max(0, offset + len(data) - len(file))
        if grown > self.free():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), name)
        file.extend(bytes(grown))
        file[offset : offset + len(data)] = data

    def sync(self, name: str) -> None:
        """Nothing can be made safer than it is."""
        self._file(name)

    def sync_folder(self, folder: str = "") -> None:
        """Nothing can be made safer than it is."""

    def rename(self, old: str, new: str) -> None:
        """Give a file another name."""
        self._files[require_name(new)] = self._file(old)
        del self._files[old]

    def remove(self, name: str) -> None:
        """Take a file away."""
        self._file(name)
        del self._files[name]

    def free(self) -> int:
        """Tell how many bytes there is room for."""
        return self._room - sum(map(len, self._files.values()))

    def _file(self, name: str) -> bytearray:
        if name not in self._files:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        return self._files[name]
