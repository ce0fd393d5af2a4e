"""What a recording answers when it is asked as if it were the camera: who it was, what it held, and that nothing can be set."""

from __future__ import annotations

from prismstereo.recording.notes import ClockNote, SessionNote
from prismstereo.recording.recording import Recording
from prismstereo_device.objects import Held, ObjectNumber, WriteStatus
from prismstereo_device.protocol import (
    Capability,
    CommandReply,
    CommandStatus,
    HelloReply,
    Pong,
    ReadRequest,
    WriteReply,
    answer_read,
    calibration_hash,
    read_bulk_request,
)
from prismstereo_device.wire import LIMITS, VERSION_MAX

__all__ = ["answer_bulk", "answer_command", "answer_hello", "answer_ping", "first_session"]

_SHOWN = Capability.RAW | Capability.PREVIEW | Capability.ZONES | Capability.PLANES
_WHY = "this is a recording: it shows what was, and nothing can be set, done or written"


def first_session(recording: Recording) -> SessionNote:
    """Say with whom the recording begins; one that lost its texts begins with a camera of no name."""
    if recording.sessions:
        return recording.sessions[min(recording.sessions)]
    return SessionNote(1, bytes(8).hex(), 1, bytes(8).hex(), int(_SHOWN), VERSION_MAX, 0)


def answer_hello(session: SessionNote, nonce: int, boot_id: int, calibration: bytes | None) -> bytes:
    """Accept a host's offer as the camera of this session; `calibration` is what it holds now."""
    return HelloReply(
        version=VERSION_MAX,
        nonce=nonce,
        mtu=LIMITS.payload,
        device_id=bytes.fromhex(session.device_id),
        boot_id=boot_id & 0xFFFF_FFFF,
        calibration_hash=calibration_hash(calibration or b""),
        capabilities=Capability.known(session.capabilities) & _SHOWN | Capability.COMPACT,
    ).pack()


def answer_ping(t_host_us: int, clock: ClockNote | None, recorded_us: int) -> bytes:
    """Tell the camera's clock at `recorded_us` of the host's; with no `clock`, a stamp that no reader takes for one."""
    if clock is None:
        return Pong(t_host_us, 1, 0).pack()  # answered before it was asked
    device_us = min(max(0, clock.device_us(recorded_us)), (1 << 63) - 1)
    return Pong(t_host_us, device_us, device_us).pack()


def answer_command() -> bytes:
    """Say why a command is not run."""
    return CommandReply(CommandStatus.REFUSED, why=_WHY).pack()


def answer_bulk(body: bytes, recording: Recording, calibration: bytes | None) -> bytes:
    """Read an object as far as it was recorded; raises WireError for what is no request."""
    request = read_bulk_request(body)
    if not isinstance(request, ReadRequest):
        return WriteReply(WriteStatus.REFUSED, request.obj, 0, _WHY).pack()
    held = _held(request.obj, recording, calibration)
    content, version = (None, 0) if held is None else (held.content, held.version)
    return answer_read(request, content, version, LIMITS.payload).pack()


def _held(obj: int, recording: Recording, calibration: bytes | None) -> Held | None:
    if obj == ObjectNumber.CALIBRATION and calibration:
        return Held(int.from_bytes(calibration_hash(calibration)[:4], "little") | 1, calibration)
    if obj == ObjectNumber.IDENTITY and recording.identity:
        return Held(1, recording.identity)
    return None
