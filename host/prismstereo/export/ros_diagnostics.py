"""How a camera and its line are, as ROS's /diagnostics: a level, a sentence, and the counters behind it."""

from __future__ import annotations

from enum import IntEnum

from prismstereo.driver import CameraStatistics
from prismstereo.events import CameraState
from prismstereo.export.ros_messages import Octet, RosMessage, header

__all__ = ["Level", "diagnostic_array"]

_WORTH_SAYING = 0.05  # of the frames since the last report


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


def diagnostic_array(
    sensor: str,
    hardware_id: str,
    state: CameraState,
    now: CameraStatistics,
    before: CameraStatistics,
    *,
    stamp_ns: int,
    period_s: float,
) -> RosMessage:
    """Say how a camera is, from its counters now and `period_s` before."""
    level, said = _judged(state, now, before, period_s)
    values = tuple(
        RosMessage("diagnostic_msgs/msg/KeyValue", {"key": key, "value": value}) for key, value in _told(now).items()
    )
    status = RosMessage(
        "diagnostic_msgs/msg/DiagnosticStatus",
        {
            "level": Octet(level),
            "name": f"{sensor}: camera and line",
            "message": said,
            "hardware_id": hardware_id,
            "values": values,
        },
    )
    return RosMessage("diagnostic_msgs/msg/DiagnosticArray", {"header": header(stamp_ns, ""), "status": (status,)})


def _judged(state: CameraState, now: CameraStatistics, before: CameraStatistics, period_s: float) -> tuple[Level, str]:
    if state is not CameraState.CONNECTED:
        return Level.ERROR, f"the camera is {state.value}: look at its cable and its supply"
    if now.health is not None and now.health.last_error:
        return Level.WARN, now.health.last_error
    frames, hurt = now.frames - before.frames, (now.partial - before.partial) + (now.lost - before.lost)
    if frames <= 0:
        return Level.STALE, f"no frames for {period_s:.1f} s: is its stream switched on?"
    share = hurt / (frames + now.lost - before.lost)
    if share > _WORTH_SAYING:
        return Level.WARN, f"{100 * share:.0f} % of the frames are lost or lack stripes: the line is slow, or disturbed"
    return Level.OK, f"{frames / period_s:.1f} frames a second"


def _told(now: CameraStatistics) -> dict[str, str]:
    numbers: dict[str, object] = {
        "frames": now.frames,
        "partial frames": now.partial,
        "lost frames": now.lost,
        "frames not taken": now.not_taken,
        "malformed messages": now.malformed,
        "sessions": now.sessions,
        "reboots": now.reboots,
        "replugs": now.replugs,
        "repeated requests": now.repeated,
        "round trip us": now.round_trip_us,
    }
    if now.health is not None:
        numbers |= {
            "frames captured": now.health.frames_captured,
            "frames dropped on the camera": now.health.frames_dropped,
            "pictures dropped on the camera": now.health.pictures_dropped,
            "half resolution": now.health.half_resolution,
            "error bound 1/16 px": now.health.bound,
            "line bytes a second": now.health.line_bytes_per_s,
            "temperature C": now.health.temperature_c,
            "uptime s": now.health.uptime_us // 1_000_000,
        }
    return {key: "unknown" if value is None else str(value) for key, value in numbers.items()}
