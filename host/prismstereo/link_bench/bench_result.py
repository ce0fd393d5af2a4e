"""What came of a run on the bench, and the figures that are told of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from prismstereo.link_bench.judging import Judgement

__all__ = ["Arrival", "BenchResult", "recovery_s"]


@dataclass(frozen=True, slots=True)
class Arrival:
    """A frame that arrived: when (s, monotonic), how long after its exposure, whether stripes were lost, what it holds.

    `bound` is its largest error in sixteenths of a pixel, `halved` whether rate control halved its sides.
    """

    at_s: float
    age_s: float
    partial: bool
    judgement: Judgement
    bound: int = 0
    halved: bool = False


@dataclass(frozen=True, slots=True)
class BenchResult:
    """The figures of one run; times None where nothing was there to time.

    `sent_frames` are all that the far end sent meanwhile. `recovery_s` is the longest time from the end of a spell of
    faults (or from the restart of the far end) to the next frame. A command whose outcome is `unknown` was cut by the end of
    a session; none may be run twice.
    """

    arrivals: tuple[Arrival, ...]
    seconds: float
    sent_frames: int
    command_s: tuple[float, ...]
    commands_unknown: int
    commands_failed: int
    run_twice: int
    recovery_s: float | None
    upload_s: float | None
    download_s: float | None
    transfer_bytes: int
    transfer_wrong: bool
    sessions: int
    far_end_cpu_percent: float

    @property
    def wrong_stripes(self) -> int:
        """Stripes that were delivered as good and are not."""
        return sum(arrival.judgement.wrong for arrival in self.arrivals)

    @property
    def stripes_ok_percent(self) -> float | None:
        """Share of the stripes sent that arrived and are right."""
        if not self.arrivals or not self.sent_frames:
            return None
        right = sum(arrival.judgement.right for arrival in self.arrivals)
        stripes_a_frame = sum(arrival.judgement.stripes for arrival in self.arrivals) / len(self.arrivals)
        return min(100.0, 100.0 * right / (stripes_a_frame * self.sent_frames))

    @property
    def passed(self) -> bool:
        """Whether nothing wrong was taken for right, and nothing was run twice."""
        return self.wrong_stripes == 0 and self.run_twice == 0 and not self.transfer_wrong

    def figures(self) -> dict[str, object]:
        """Give all figures by name, units last; None where there is none."""
        ages_ms = [1e3 * arrival.age_s for arrival in self.arrivals]
        commands_ms = [1e3 * taken_s for taken_s in self.command_s]
        gaps_ms = 1e3 * np.diff([arrival.at_s for arrival in self.arrivals])
        partial = sum(arrival.partial for arrival in self.arrivals)
        return {
            "frames_per_s": len(self.arrivals) / self.seconds,
            "whole_frames": len(self.arrivals) - partial,
            "partial_frames": partial,
            "mean_bound": float(np.mean([arrival.bound for arrival in self.arrivals])) if self.arrivals else None,
            "halved_frames": sum(arrival.halved for arrival in self.arrivals),
            "stripes_ok_percent": self.stripes_ok_percent,
            "wrong_stripes": self.wrong_stripes,
            "age_p50_ms": _percentile(ages_ms, 50),
            "age_max_ms": _percentile(ages_ms, 100),
            "commands": len(commands_ms),
            "commands_unknown": self.commands_unknown,
            "commands_failed": self.commands_failed,
            "commands_run_twice": self.run_twice,
            "command_p50_ms": _percentile(commands_ms, 50),
            "command_p99_ms": _percentile(commands_ms, 99),
            "command_max_ms": _percentile(commands_ms, 100),
            "longest_gap_ms": _percentile(list(gaps_ms), 100),
            "recovery_s": self.recovery_s,
            "upload_s": self.upload_s,
            "download_s": self.download_s,
            "transfer_bytes": self.transfer_bytes,
            "transfer_wrong": self.transfer_wrong,
            "sessions": self.sessions,
            "far_end_cpu_percent": self.far_end_cpu_percent,
            "passed": self.passed,
        }


def recovery_s(arrivals: Sequence[Arrival], ends_s: Sequence[float]) -> float | None:
    """Give the longest time from one of these ends to the next arrival; None without ends, or if nothing came after one."""
    times = [arrival.at_s for arrival in arrivals]
    waits = [next((at_s - end_s for at_s in times if at_s >= end_s), None) for end_s in ends_s]
    known = [wait_s for wait_s in waits if wait_s is not None]
    return max(known) if known and len(known) == len(waits) else None


def _percentile(values: Sequence[float], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None
