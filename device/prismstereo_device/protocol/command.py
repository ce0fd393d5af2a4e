"""Commands: get a setting, set it to a value, do something. Every command is absolute, so that a repeat is harmless.

A request's body is the JSON list `[verb, name, value]`, an answer's is one byte of status and then JSON: the value that is
in force now where the status is OK, else one sentence that says why not.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal, Self

import msgspec

from prismstereo_device.protocol.body import cut_text
from prismstereo_device.wire import WireError

__all__ = ["Command", "CommandReply", "CommandStatus", "Value", "Verb"]

Verb = Literal["get", "set", "do"]
Value = bool | int | float | str | list[int] | None

_Name = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}\Z")]
_Whole = Annotated[int, msgspec.Meta(ge=-(1 << 53), le=1 << 53)]  # what every reader of JSON holds exactly
_Read = bool | _Whole | float | str | list[_Whole] | None
_SAID_BYTES = 127  # with its status, a sentence fits the smallest packet
_JSON = msgspec.json.Encoder()


class CommandStatus(IntEnum):
    """How a command ended."""

    OK = 0
    UNKNOWN = 1  # this device knows no such name
    REFUSED = 2  # the value is outside the rule that the text names
    FAILED = 3  # the device tried, and could not
    BUSY = 4  # another one of the same kind is under way
    STALE = 5  # the request is too old to know whether it was run: it was not run now


class _Body(msgspec.Struct, frozen=True, array_like=True):
    verb: Verb
    name: _Name
    value: _Read = None


@dataclass(frozen=True, slots=True)
class Command:
    """`get` or `set` a setting by name, or `do` an action; `value` is what it is set to or done with."""

    verb: Verb
    name: str
    value: Value = None

    def pack(self) -> bytes:
        """Give the body's bytes."""
        return _JSON.encode([self.verb, self.name, self.value])

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a command, whatever a later version put behind it; raises WireError."""
        try:
            read = msgspec.json.decode(body, type=_Body)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise WireError(f"a command of {len(body)} bytes that is not [verb, name, value] ({error})") from error
        return cls(read.verb, read.name, read.value)


@dataclass(frozen=True, slots=True)
class CommandReply:
    """`value`: what is in force now where the status is OK; `why`: else what is wrong, by value, rule and mend."""

    status: CommandStatus
    value: Value = None
    why: str = ""

    def pack(self) -> bytes:
        """Give the body's bytes; a long sentence is cut."""
        said = self.value if self.status is CommandStatus.OK else _sentence(self.why)
        return bytes([self.status]) + _JSON.encode(said)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read an answer; raises WireError."""
        if not body or body[0] > max(CommandStatus):
            raise WireError(f"an answer of status {body[:1].hex() or 'missing'}: 0 to {max(CommandStatus)} are known")
        status = CommandStatus(body[0])
        try:
            if status is CommandStatus.OK:
                return cls(status, msgspec.json.decode(body[1:], type=_Read))
            return cls(status, why=msgspec.json.decode(body[1:], type=str))
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise WireError(f"an answer of {len(body)} bytes whose value cannot be read ({error})") from error


def _sentence(text: str) -> str:
    """Cut a sentence to what fits the smallest packet as JSON, whose escapes may be longer than what they stand for."""
    most = _SAID_BYTES - 2
    while True:
        said = cut_text(text, most).decode()
        excess = len(_JSON.encode(said)) - _SAID_BYTES
        if excess <= 0:
            return said
        most = min(most, len(said.encode())) - -(-excess // 5)  # an escape adds 5 bytes at most
