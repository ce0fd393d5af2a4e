"""Who may talk to the viewer: the names it answers to, the pages it listens to, and the token of those from elsewhere.

On loopback a web page in the user's own browser is the danger: it is kept out by the Host header (a name that was made to point
here) and by Origin (a request from another page). Anywhere else there is a token of 128 bits beside that.
"""

from __future__ import annotations

import ipaddress
import secrets
import socket
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

__all__ = ["Access"]

_TOKEN_BYTES = 16
_LOOPBACK_NAMES = frozenset({"localhost"})


@dataclass(frozen=True, slots=True)
class Access:
    """The rules of one server that listens on `address`; `token` is None on loopback.

    `entrance` is what a browser's cookie holds once it has shown the token; it is drawn at each start.
    """

    address: str
    names: frozenset[str]
    token: str | None
    entrance: str = field(default_factory=lambda: secrets.token_urlsafe(_TOKEN_BYTES))

    @classmethod
    def to(cls, address: str) -> Access:
        """Make the rules for a server on an address (an IP address or a name of this machine)."""
        if is_loopback(address):
            return cls(address, _LOOPBACK_NAMES, None)
        own = socket.gethostname().lower()
        names = _LOOPBACK_NAMES | {own, own.partition(".")[0], f"{own.partition('.')[0]}.local", address.lower()}
        return cls(address, names, secrets.token_urlsafe(_TOKEN_BYTES))

    def knows_host(self, host: str | None) -> bool:
        """Whether a Host header names this server; a number cannot be made to point elsewhere, a foreign name can."""
        name = _name_of(host)
        if name is None:
            return False
        try:
            number = ipaddress.ip_address(name)
        except ValueError:
            return name in self.names
        return self.token is not None or number.is_loopback

    def knows_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether a request comes from the very page that this server gave out; none, and `null`, are foreign."""
        if origin is None or host is None:
            return False
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()

    def admits(self, cookie: str | None, authorization: str | None) -> bool:
        """Whether a cookie, or an `Authorization: Bearer` header, shows that its sender knows the token."""
        if self.token is None:
            return True
        scheme, _, given = (authorization or "").partition(" ")
        by_header = scheme.lower() == "bearer" and _same(given.strip(), self.token)
        return _same(cookie or "", self.entrance) or by_header

    def opens(self, token: str) -> bool:
        """Whether this is the token."""
        return self.token is None or _same(token, self.token)


def is_loopback(address: str) -> bool:
    """Whether nobody but this machine reaches a server on an address."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.lower() in _LOOPBACK_NAMES


def header(headers: Iterable[tuple[bytes, bytes]], name: str) -> str | None:
    """Give a header's value; None where it is missing, said twice, or not ASCII."""
    found = [value for key, value in headers if key.lower() == name.encode()]
    if len(found) != 1 or not found[0].isascii():
        return None
    return found[0].decode("ascii")


def cookies(value: str | None) -> Mapping[str, str]:
    """Read a Cookie header."""
    pairs = (part.strip().partition("=") for part in (value or "").split(";"))
    return {name: given for name, found, given in pairs if found}


def _same(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())


def _name_of(host: str | None) -> str | None:
    """Give the name or number in a Host header, without its port; None for what is no such header."""
    if not host or any(letter in host for letter in "/@\\ ?#"):
        return None
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None
