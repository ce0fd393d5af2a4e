"""The self-test: what a camera can find out about itself while it streams, each finding with its mend."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import msgspec

from prismstereo_device.objects import Held
from prismstereo_device.state import Disk

__all__ = ["Facts", "Finding", "SelfTest", "Surroundings", "Verdict", "available_bytes", "findings", "storage_error"]

_SLOW = 0.9  # of the wished rate
_HOT_C, _TOO_HOT_C = 75.0, 85.0  # boards slow down at 80 to 85
_LITTLE_MEMORY, _TOO_LITTLE_MEMORY = 128 << 20, 32 << 20
_FEW_FRAMES = 5
_PROBE, _PROBE_BYTES = "self-test", bytes(range(256)) * 16
_MEMORY = Path("/proc/meminfo")


class Verdict(StrEnum):
    """How grave a finding is."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding: what was looked at, the verdict, the figures, and what to do about it."""

    name: str
    verdict: Verdict
    said: str
    mend: str = ""


@dataclass(frozen=True, slots=True)
class Facts:
    """What the frame loop knows at one moment; None where nobody can tell.

    `away`: why the camera is not there, empty where it is. `wished_rate_hz` 0: as fast as it comes. `unfit`: why the newest
    frame was not matched, empty where it was. `match_ms` is the median of the last matches.
    """

    frames: int
    away: str
    losses: int
    rate_hz: float | None
    wished_rate_hz: float
    backward_stamps: int
    unfit: str
    frame_size: tuple[int, int] | None
    calibrated_size: tuple[int, int]
    match_ms: float | None
    temperature_c: float | None


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What storage and system know: `storage_error` is empty where something could be written and read back."""

    factory_copy: bool
    persistent: bool
    storage_error: str
    memory_bytes: int | None


def findings(facts: Facts, around: Surroundings) -> tuple[Finding, ...]:
    """Judge the facts, in the order in which a person would look."""
    inner = tuple(judge(facts) for judge in (_camera, _rate, _clock, _size, _matcher, _temperature))
    return (*inner, *(judge(around) for judge in (_calibration, _storage, _memory)))


class SelfTest:
    """Judges the frame loop's facts together with storage and system, in `worker`, and gives the report to `keep`.

    The report is JSON: `ok` (nothing failed), `timestamp_us` (the device's clock), `findings`. `factory_copy` says whether a
    factory calibration is kept; `done` is called at the end.
    """

    def __init__(
        self,
        worker: Executor,
        disk: Disk,
        *,
        factory_copy: Callable[[], bool],
        keep: Callable[[Held], None],
        done: Callable[[], None],
    ) -> None:
        self._worker, self._disk = worker, disk
        self._factory_copy, self._keep, self._done = factory_copy, keep, done

    def run(self, facts: Facts) -> None:
        """Begin with what the frame loop knows; returns at once."""
        self._worker.submit(self._judge, facts)

    def _judge(self, facts: Facts) -> None:
        try:
            around = Surroundings(
                self._factory_copy(), self._disk.persistent, storage_error(self._disk), available_bytes()
            )
            found = findings(facts, around)
            passed = all(finding.verdict is not Verdict.FAIL for finding in found)
            told = {"ok": passed, "timestamp_us": time.monotonic_ns() // 1000, "findings": found}
            content = msgspec.json.encode(told)
            self._keep(Held(zlib.crc32(content) or 1, content))
        finally:
            self._done()


def storage_error(disk: Disk) -> str:
    """Write, sync, read back and remove a small file; give what went wrong, empty where nothing did."""
    try:
        disk.write(_PROBE, _PROBE_BYTES)
        disk.sync(_PROBE)
        same = disk.read(_PROBE) == _PROBE_BYTES
        disk.remove(_PROBE)
    except OSError as error:
        return f"a file could not be written: {error.strerror or error}"
    return "" if same else "a file reads back as other bytes than were written"


def available_bytes(source: Path = _MEMORY) -> int | None:
    """Tell how much memory programs can still have; None where the system does not say."""
    try:
        lines = source.read_text("ascii", "replace").splitlines()
    except OSError:
        return None
    for line in lines:
        name, _, rest = line.partition(":")
        words = rest.split()
        if name == "MemAvailable" and words and words[0].isdigit():
            return int(words[0]) * 1024
    return None


def _camera(facts: Facts) -> Finding:
    if facts.away:
        return Finding("camera", Verdict.FAIL, f"it went away: {facts.away}", "check its cable and its power")
    if facts.losses:
        said = f"{facts.frames} frames; it went away {facts.losses} times and came back"
        return Finding("camera", Verdict.WARN, said, "check its cable and its power")
    if not facts.frames:
        return Finding("camera", Verdict.FAIL, "no frame has come yet", "check that nothing else has it open")
    return Finding("camera", Verdict.OK, f"{facts.frames} frames")


def _rate(facts: Facts) -> Finding:
    if facts.rate_hz is None or facts.frames < _FEW_FRAMES:
        return Finding("rate", Verdict.WARN, f"{facts.frames} frames are too few to tell", "test again in a second")
    said = f"{facts.rate_hz:.1f} frames/s"
    if facts.wished_rate_hz and facts.rate_hz < _SLOW * facts.wished_rate_hz:
        said += f" of {facts.wished_rate_hz:g} wished for"
        return Finding("rate", Verdict.WARN, said, "shorten the exposure, make the region smaller, or wish for less")
    return Finding("rate", Verdict.OK, said)


def _clock(facts: Facts) -> Finding:
    if facts.backward_stamps:
        said = f"{facts.backward_stamps} stamps were not after the one before"
        return Finding("clock", Verdict.FAIL, said, "use a sensor with a monotonic clock")
    return Finding("clock", Verdict.OK, "every stamp is after the one before")


def _size(facts: Facts) -> Finding:
    wide, high = facts.calibrated_size
    if facts.unfit:
        return Finding("frames", Verdict.FAIL, facts.unfit, "capture in the calibrated mode, or calibrate this one")
    if facts.frame_size is None:
        return Finding("frames", Verdict.WARN, "no frame has come yet", "test again in a second")
    if facts.frame_size != facts.calibrated_size:
        said = f"{facts.frame_size[0]}x{facts.frame_size[1]}, the calibration is for {wide}x{high}"
        return Finding("frames", Verdict.FAIL, said, "capture in the calibrated mode, or calibrate this one")
    return Finding("frames", Verdict.OK, f"{wide}x{high}, as calibrated")


def _calibration(around: Surroundings) -> Finding:
    if not around.factory_copy:
        said = "readable, but no factory copy is kept"
        return Finding("calibration", Verdict.WARN, said, "write the unit's own with `prismstereo flash`")
    return Finding("calibration", Verdict.OK, "readable, and a factory copy is kept")


def _storage(around: Surroundings) -> Finding:
    if around.storage_error:
        return Finding("storage", Verdict.FAIL, around.storage_error, "free some room, or exchange the card")
    if not around.persistent:
        said = "nothing is kept over a restart"
        return Finding("storage", Verdict.WARN, said, "start with --state DIR")
    return Finding("storage", Verdict.OK, "what is written can be read back")


def _matcher(facts: Facts) -> Finding:
    if facts.match_ms is None:
        return Finding("matcher", Verdict.OK, "nothing was asked of it")
    said = f"{facts.match_ms:.1f} ms a frame"
    if facts.wished_rate_hz and facts.match_ms > 1000 / facts.wished_rate_hz:
        said += f", {1000 / facts.wished_rate_hz:.1f} ms are there at {facts.wished_rate_hz:g} frames/s"
        return Finding("matcher", Verdict.WARN, said, "choose a quicker matcher, a smaller region, or a lower rate")
    return Finding("matcher", Verdict.OK, said)


def _temperature(facts: Facts) -> Finding:
    if facts.temperature_c is None:
        return Finding("temperature", Verdict.OK, "nothing here measures it")
    said = f"{facts.temperature_c:.0f} degrees C"
    if facts.temperature_c >= _HOT_C:
        verdict = Verdict.FAIL if facts.temperature_c >= _TOO_HOT_C else Verdict.WARN
        return Finding("temperature", verdict, said, "give it air, or a lower rate")
    return Finding("temperature", Verdict.OK, said)


def _memory(around: Surroundings) -> Finding:
    if around.memory_bytes is None:
        return Finding("memory", Verdict.OK, "the system does not tell")
    said = f"{around.memory_bytes >> 20} MiB available"
    if around.memory_bytes < _LITTLE_MEMORY:
        verdict = Verdict.FAIL if around.memory_bytes < _TOO_LITTLE_MEMORY else Verdict.WARN
        return Finding("memory", verdict, said, "end other programs, or choose a smaller frame")
    return Finding("memory", Verdict.OK, said)
