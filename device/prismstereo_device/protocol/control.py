"""Keeping the session: clock probes and the acknowledgement of frames. Each body begins with its kind."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from prismstereo_device.protocol.body import read_fields, read_grown
from prismstereo_device.wire import LIMITS, WireError

__all__ = ["FrameAck", "Ping", "Pong", "read_control"]

_PERMILLE = 1000


@dataclass(frozen=True, slots=True)
class Ping:
    """Ask the other end for its clock; `t_host_us` is the asker's own, in microseconds."""

    t_host_us: int

    KIND: ClassVar[int] = 1
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        return self._LAYOUT.pack(self.KIND, self.t_host_us)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a ping; raises WireError."""
        return cls(*_fields(cls._LAYOUT, body, cls.KIND, "a ping"))


@dataclass(frozen=True, slots=True)
class Pong:
    """Answer a ping: its own stamp, when it came in, when the answer went out (the answerer's clock); microseconds."""

    t_host_us: int
    t_rx_us: int
    t_tx_us: int

    KIND: ClassVar[int] = 2
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQQQ")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        return self._LAYOUT.pack(self.KIND, self.t_host_us, self.t_rx_us, self.t_tx_us)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a pong; raises WireError."""
        return cls(*_fields(cls._LAYOUT, body, cls.KIND, "a pong"))


@dataclass(frozen=True, slots=True)
class FrameAck:
    """Acknowledge frames, cumulatively: the newest one whose start was seen, and how many more there is room for.

    Repeated every 100 ms, so that a lost one costs nothing. `room` 0 asks the device to wait. `loss_permille` is the share of
    packets that lately reached the host damaged, or not at all: what the device should size its packets by.
    """

    newest_frame: int
    room: int = LIMITS.frames_unacknowledged
    loss_permille: int = 0

    KIND: ClassVar[int] = 3
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BI")
    _ROOM: ClassVar[struct.Struct] = struct.Struct("<B")
    _LOSS: ClassVar[struct.Struct] = struct.Struct("<H")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        room, loss = min(self.room, 255), max(0, min(self.loss_permille, _PERMILLE))
        return self._LAYOUT.pack(self.KIND, self.newest_frame) + self._ROOM.pack(room) + self._LOSS.pack(loss)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read an acknowledgement, with or without room and loss; raises WireError."""
        (newest_frame,) = _fields(cls._LAYOUT, body, cls.KIND, "a frame acknowledgement")
        (room,) = read_grown(cls._ROOM, body, cls._LAYOUT.size) or (LIMITS.frames_unacknowledged,)
        (loss,) = read_grown(cls._LOSS, body, cls._LAYOUT.size + cls._ROOM.size) or (0,)
        return cls(newest_frame, room, min(loss, _PERMILLE))


def _fields(layout: struct.Struct, body: bytes, due: int, what: str) -> tuple[int, ...]:
    kind, *fields = read_fields(layout, body, what)
    if kind != due:
        raise WireError(f"{what} of kind {kind}: it has kind {due}")
    return tuple(fields)


_READERS: Mapping[int, Callable[[bytes], Ping | Pong | FrameAck]] = {
    Ping.KIND: Ping.unpack,
    Pong.KIND: Pong.unpack,
    FrameAck.KIND: FrameAck.unpack,
}


def read_control(body: bytes) -> Ping | Pong | FrameAck:
    """Read whatever came on the control channel; raises WireError, also on a kind that this version does not know."""
    reader = _READERS.get(body[0]) if body else None
    if reader is None:
        raise WireError(f"a control message of kind {body[:1].hex() or 'missing'}: known are {sorted(_READERS)}")
    return reader(body)
