"""What is put on the bench: a line, its faults, and the frames that go over it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from prismstereo.link_bench.fault_plan import FaultPlan
from prismstereo_hw.errors import UsageError

__all__ = ["BenchCase", "standard_cases"]

_SLOWEST_BAUD, _FASTEST_BAUD = 9600, 400_000_000


@dataclass(frozen=True, slots=True)
class BenchCase:
    """One run: `seconds` of frames of `width` x `height` at `rate_hz`, coded within `bound` sixteenths (None: automatic).

    `baud` is the line's speed, 10 bits a byte; with `reboot` the far end is killed half-way and started again. Raises
    UsageError for what cannot be run.
    """

    name: str
    faults: str = ""
    baud: int = 3_000_000
    seconds: float = 6.0
    width: int = 640
    height: int = 360
    rate_hz: float = 15.0
    bound: int | None = 1
    kind: Literal["pty", "tcp"] = "pty"
    reboot: bool = False
    seed: int = 1

    def __post_init__(self) -> None:
        """Refuse a line that is none."""
        FaultPlan.parse(self.faults)
        if not _SLOWEST_BAUD <= self.baud <= _FASTEST_BAUD:
            raise UsageError(f"a line of {self.baud} baud: give {_SLOWEST_BAUD} to {_FASTEST_BAUD}")

    @property
    def transfer_bytes(self) -> int:
        """How much is sent up and fetched back beside the frames: what takes the line about half a second."""
        return max(2_000, min(60_000, self.baud // 20))


_FAULTS = {
    "flips 1e-5": "flips=1e-5",
    "flips 1e-4": "flips=1e-4",
    "flips 1e-3": "flips=1e-3",
    "flips 1e-2": "flips=1e-2",
    "bits 1e-5": "bits=1e-5",
    "drops 1e-4": "drops=1e-4",
    "dups 1e-4": "dups=1e-4",
    "chunkdrop 2 %": "chunkdrop=0.02",
    "garbage 5 %": "garbage=0.05",
    "stall 0.2 s of 1": "stall=0.2/1",
    "stall 2 s of 5": "stall=2/5",
    "wrong baud 0.5 s of 2": "baud=0.5/2",
    "line dead 1 s of 3": "cut=1/3",
    "replug 0.2 s of 2": "replug=0.2/2",
}


def standard_cases(like: BenchCase) -> list[BenchCase]:
    """Give the table's cases: a clean line at three speeds, every fault on the line of `like`, and a reboot."""
    clean = [
        replace(like, name=f"clean {baud}", faults="", baud=baud, rate_hz=rate_hz, reboot=False)
        for baud, rate_hz in ((3_000_000, 15.0), (921_600, 5.0), (115_200, 5.0))
    ]
    faulty = [replace(like, name=name, faults=faults, reboot=False) for name, faults in _FAULTS.items()]
    return [*clean, *faulty, replace(like, name="killed and restarted", faults="", reboot=True)]
