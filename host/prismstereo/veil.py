"""What is nobody else's business, taken out of text before it leaves this machine: names, home folders, passwords."""

from __future__ import annotations

import getpass
import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Self

__all__ = ["Veil"]

_LEAST_NAME = 3  # shorter names are parts of words
_COMMON = frozenset({"root", "user", "localhost", "host", "pi", "admin", "prismstereo"})
_HUSHED = "token|passw(?:or)?d|passwd|secret|api_?key|private_?key|authorization"
_HOMES = re.compile(r"(/home/|/Users/|[A-Za-z]:\\+Users\\+)[^/\\\s\"':;]+")
_LOGIN = re.compile(r"(//)[^/@\s]+@")
_ASSIGNED = re.compile(rf"(?i)\b({_HUSHED})(\s*[=:]\s*)\S+")
_HUSHED_KEY = re.compile(rf"(?i)({_HUSHED})")
_HIDDEN = "***"


class Veil:
    """Hides the given home folders, user names and host names, and whatever looks like a login or a secret."""

    def __init__(self, homes: tuple[str, ...] = (), users: tuple[str, ...] = (), hosts: tuple[str, ...] = ()) -> None:
        self._homes = tuple(sorted({home for home in homes if len(home) > len("/x")}, key=len, reverse=True))
        self._names = [(_word(users), "user"), (_word(hosts), "host")]

    @classmethod
    def of_this_machine(cls) -> Self:
        """Hide whoever runs this, and where."""
        home = Path.home()
        host = socket.gethostname()
        return cls((str(home), os.path.realpath(home)), (_user(), home.name), (host, host.partition(".")[0]))

    def text(self, text: str) -> str:
        """Give a text without them."""
        for home in self._homes:
            text = text.replace(home, "~")
        text = _HOMES.sub(r"\1user", text)
        text = _ASSIGNED.sub(rf"\1\2{_HIDDEN}", _LOGIN.sub(r"\1", text))
        for name, stand_in in self._names:
            if name is not None:
                text = name.sub(stand_in, text)
        return text

    def plain(self, value: object) -> object:
        """Give a value of JSON without them; what a key calls a secret is hidden whole."""
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, Mapping):
            return {
                str(key): _HIDDEN if _HUSHED_KEY.search(str(key)) and isinstance(item, str) else self.plain(item)
                for key, item in value.items()
            }
        if isinstance(value, list | tuple):
            return [self.plain(item) for item in value]
        return value

    def betrayed_by(self, data: bytes) -> bool:
        """Tell whether bytes of any kind hold a home folder; names alone are too short to be looked for there."""
        return any(home.encode() in data for home in self._homes)


def _word(names: tuple[str, ...]) -> re.Pattern[str] | None:
    """Make a pattern of names that stand alone; those that say nothing are left as they are."""
    telling = sorted({name for name in names if len(name) >= _LEAST_NAME and name.lower() not in _COMMON}, key=len)
    if not telling:
        return None
    return re.compile(rf"(?i)(?<![A-Za-z0-9])(?:{'|'.join(map(re.escape, reversed(telling)))})(?![A-Za-z0-9])")


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):  # nobody of that number is known here
        return ""
