"""A line that goes wrong on purpose, for tests and for the bench.

with FaultLine("flips=1e-4", baud=3_000_000) as line:
device = open_link(line.device_port, baud=3_000_000)
host = open_link(line.host_port, baud=3_000_000)
"""

from __future__ import annotations

import os
import tempfile
import time
from types import TracebackType
from typing import Literal, Self

from prismstereo.link_bench.child import Child
from prismstereo.link_bench.fault_plan import FaultPlan
from prismstereo_hw.errors import UsageError

__all__ = ["FaultLine"]

_BITS_PER_BYTE = 10


class FaultLine:
    """A relay process with two ends to open, by `open_link`: `device_port` and `host_port`.

    `faults` is a plan as `FaultPlan.parse` reads it; with `baud` the line carries no more than a UART of that speed. The
    faults that come and go are timed from `since_s`, in seconds of `time.monotonic`. Raises UsageError.
    """

    def __init__(
        self, faults: str = "", *, baud: int | None = None, kind: Literal["pty", "tcp"] = "pty", seed: int = 1
    ) -> None:
        if os.name != "posix":
            raise UsageError("a line with faults needs a POSIX system: run this on Linux or macOS")
        self._speed = "" if baud is None else f"slow={baud / _BITS_PER_BYTE:g},"
        FaultPlan.parse(faults)
        self._folder = tempfile.TemporaryDirectory(prefix="prismstereo-line-")
        wish = {"folder": self._folder.name, "kind": kind, "plan": self._speed + faults, "seed": seed}
        try:
            self._relay = Child("prismstereo.link_bench.relay", wish)
        except BaseException:
            self._folder.cleanup()
            raise
        self.device_port = str(self._relay.first["device"])
        self.host_port = str(self._relay.first["host"])
        self.since_s = _number(self._relay.first, "since_s")

    def set_faults(self, faults: str) -> None:
        """Go wrong in another way from now on; an empty plan is a clean line. Raises UsageError."""
        FaultPlan.parse(faults)
        self.since_s = _number(self._relay.ask({"do": "faults", "plan": self._speed + faults}), "since_s")

    def unplug(self) -> None:
        """Pull the host's plug."""
        self._relay.ask({"do": "unplug"})

    def plug(self) -> None:
        """Put the host's plug in again: a new port under the same name."""
        self._relay.ask({"do": "plug"})

    def replug(self, away_s: float = 0.0) -> None:
        """Pull the host's plug and put it in again."""
        self.unplug()
        time.sleep(away_s)
        self.plug()

    def carried_bytes(self) -> tuple[int, int]:
        """Count what came out of the line since its faults were set: (at the camera, at the host)."""
        counts = self._relay.ask({"do": "count"})
        return int(_number(counts, "up_bytes")), int(_number(counts, "down_bytes"))

    def close(self) -> None:
        """End the line; closing twice does no harm."""
        self._relay.stop()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _number(line: dict[str, object], key: str) -> float:
    value = line[key]
    assert isinstance(value, int | float)
    return float(value)
