"""How things stand with a camera, as plain numbers with their units."""

from __future__ import annotations

from collections.abc import Mapping

from prismstereo.driver import StereoCamera
from prismstereo.viewer.watch import Watch
from prismstereo_device.protocol import Health

__all__ = ["state_of"]

_STAMPS_OF_A_CLOCK = (
    60_000_000  # a frame that seems older than a minute has a stamp that is no time of this camera's clock
)


def state_of(camera: StereoCamera, watch: Watch, details: Mapping[str, object] | None) -> dict[str, object]:
    """Tell counters, rates and delays; None where something is not known."""
    statistics, identity, clock = camera.statistics, camera.identity, camera.clock
    newest = watch.newest
    return {
        "state": camera.state.value,
        "device": identity.device_id.hex(),
        "product": None if details is None else details.get("product"),
        "firmware": None if details is None else details.get("version"),
        "frames_per_s": round(watch.rate_hz, 2),
        "frames": statistics.frames,
        "partial": statistics.partial,
        "lost": statistics.lost,
        "not_taken": statistics.not_taken,
        "malformed": statistics.malformed,
        "sessions": statistics.sessions,
        "received_bytes": statistics.line.received_bytes,
        "packets_bad": statistics.line.bad + statistics.line.oversize,
        "packets_good": statistics.line.good,
        "round_trip_ms": None if statistics.round_trip_us is None else statistics.round_trip_us / 1000,
        "clock_bound_ms": None if clock is None else clock.bound_us / 1000,
        "latency_ms": _latency_ms(camera, watch),
        "density": None if newest is None else newest.disparity.density,
        "health": None if statistics.health is None else _health(statistics.health),
    }


def _latency_ms(camera: StereoCamera, watch: Watch) -> float | None:
    """From mid-exposure to the arrival here; None where the stamps are those of a recording or of a made-up clock."""
    clock, newest = camera.clock, watch.newest
    if clock is None or newest is None:
        return None
    late_us = watch.arrived_us - clock.host_time_us(newest.timestamp_us)
    return late_us / 1000 if -clock.bound_us <= late_us < _STAMPS_OF_A_CLOCK else None


def _health(health: Health) -> dict[str, object]:
    return {
        "captured": health.frames_captured,
        "sent": health.frames_sent,
        "dropped": health.frames_dropped,
        "pictures_dropped": health.pictures_dropped,
        "uptime_s": health.uptime_us / 1e6,
        "temperature_c": health.temperature_c,
        "bound_px": None if health.bound is None else health.bound / 16,
        "half_resolution": health.half_resolution,
        "line_bytes_per_s": health.line_bytes_per_s,
        "last_error": health.last_error,
    }
