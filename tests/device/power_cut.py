"""A disk whose power can be cut, or that can fail, at any call.

After a cut, of what was not synced every 4 KiB block is old, new or zero at random, the size is anything between, and each
new, changed or removed name is there or not, each for itself and in any order. This is more than any file system does at once,
and no less than POSIX allows.
"""

from __future__ import annotations

import errno
import io
import random
from typing import BinaryIO

BLOCK = 4096


class PowerCut(BaseException):
    """The end of a run, wherever it was; nobody catches it on the way."""


class File:
    """What is written and what is safe of it."""

    def __init__(self, safe: bytes = b"") -> None:
        self.now, self.safe = bytearray(safe), safe

    def after_a_cut(self, rng: random.Random) -> File:
        size = rng.randint(*sorted((len(self.safe), len(self.now))))
        left = bytearray(size)
        for start in range(0, size, BLOCK):
            stop = min(start + BLOCK, size)
            source = rng.choice((self.safe, self.now, b""))
            block = bytes(source[start:stop])
            left[start : start + len(block)] = block
        return File(bytes(left) if bytes(self.now) != self.safe else self.safe)


class ModelDisk:
    """Files in memory. At the call number `cut_at` (from 0) the power goes; `fail_at` fails, alone or with all after it."""

    persistent = True

    def __init__(self, files: dict[str, bytes] | None = None) -> None:
        self.files = {name: File(content) for name, content in (files or {}).items()}
        self.safe = dict(self.files)
        self.pending: list[tuple[str | None, str | None, File | None]] = []  # old name, new name, file
        self.calls = 0
        self.cut_at: int | None = None
        self.fail_at: int | None = None
        self.fail_for_ever = False

    def after_a_cut(self, rng: random.Random) -> ModelDisk:
        """Give the disk as the next start finds it."""
        names = dict(self.safe)
        changes = [change for change in self.pending if rng.random() < 0.5]
        rng.shuffle(changes)
        for old, new, file in changes:
            if old is not None:
                names.pop(old, None)
            if new is not None and file is not None:
                names[new] = file
        left = {id(file): file.after_a_cut(rng) for file in names.values()}
        disk = ModelDisk()
        disk.files = {name: left[id(file)] for name, file in names.items()}
        disk.safe = dict(disk.files)
        return disk

    def after_a_kill(self) -> ModelDisk:
        """Give the disk as a new process finds it when only the old one died: nothing is lost, nothing was synced."""
        disk = ModelDisk()
        disk.files, disk.safe, disk.pending = dict(self.files), dict(self.safe), list(self.pending)
        return disk

    def names(self, folder: str = "") -> list[str]:
        self._call()
        return sorted(name for name in self.files if name.rpartition("/")[0] == folder)

    def size(self, name: str) -> int:
        return len(self.read(name))

    def read(self, name: str) -> bytes:
        self._call()
        return bytes(self._file(name).now)

    def open(self, name: str) -> BinaryIO:
        return io.BytesIO(self.read(name))

    def write(self, name: str, data: bytes) -> None:
        if name not in self.files:
            self._call()
            self.files[name] = File()
            self.pending.append((None, name, self.files[name]))
        self._file(name).now.clear()
        self.write_at(name, 0, data)

    def write_at(self, name: str, offset: int, data: bytes) -> None:
        file = self._file(name)
        file.now.extend(bytes(max(0, offset - len(file.now))))
        half = len(data) // 2
        file.now[offset : offset + half] = data[:half]
        self._call()
        file.now[offset : offset + len(data)] = data

    def sync(self, name: str) -> None:
        self._call()
        self._file(name).safe = bytes(self._file(name).now)

    def sync_folder(self, folder: str = "") -> None:
        self._call()
        for name in {*self.files, *self.safe}:
            if name.rpartition("/")[0] == folder:
                if name in self.files:
                    self.safe[name] = self.files[name]
                else:
                    del self.safe[name]
        self.pending = [change for change in self.pending if not _within(change, folder)]

    def rename(self, old: str, new: str) -> None:
        self._call()
        file = self._file(old)
        del self.files[old]
        self.files[new] = file
        self.pending.append((old, new, file))

    def remove(self, name: str) -> None:
        self._call()
        self._file(name)
        del self.files[name]
        self.pending.append((name, None, None))

    def free(self) -> int:
        self._call()
        return 1 << 30

    def _file(self, name: str) -> File:
        if name not in self.files:
            raise FileNotFoundError(errno.ENOENT, "No such file", name)
        return self.files[name]

    def _call(self) -> None:
        number = self.calls
        self.calls += 1
        if number == self.cut_at:
            raise PowerCut
        if self.fail_at is not None and (number == self.fail_at or (self.fail_for_ever and number > self.fail_at)):
            raise OSError(errno.EIO, "Input/output error")


def _within(change: tuple[str | None, str | None, File | None], folder: str) -> bool:
    return all(name is None or name.rpartition("/")[0] == folder for name in change[:2])
