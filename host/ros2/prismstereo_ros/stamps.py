"""The camera's time as ROS time: by way of this computer's own clock, to which the driver knows the camera's."""

from __future__ import annotations

from prismstereo import ClockMapping

__all__ = ["stamp_ns"]

_NS_PER_US = 1000


def stamp_ns(device_us: int, clock: ClockMapping | None, *, now_ns: int, monotonic_ns: int) -> int:
    """Give the ROS time of an exposure, where it is `now_ns` at `monotonic_ns`; before the clocks are compared, say now."""
    if clock is None:
        return now_ns
    return now_ns - (monotonic_ns - _NS_PER_US * clock.host_time_us(device_us))
