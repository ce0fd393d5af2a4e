"""The built-in simulated device: the real firmware in a process of its own, on a pseudo-terminal or on loopback TCP."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
from types import TracebackType
from typing import IO, Self

from prismstereo_hw.errors import DeviceError

__all__ = ["SimulatedDevice"]

_START_S = 120.0  # the first start on a machine compiles kernels
_STOP_S = 20.0


class SimulatedDevice:
    """Runs `prismstereo-device` with a twin sensor; a context manager whose `address` a `StereoCamera` opens.

    After `frames` the stream ends; with `rate_hz` it is no faster than that; with `lossless` the firmware waits for the host
    instead of dropping frames. Its log goes to standard error from `log_level` on. `statistics` holds the firmware's own
    counters once it was stopped. Raises DeviceError where it does not start.
    """

    def __init__(
        self,
        sensor: str,
        *,
        frames: int | None = None,
        lossless: bool = True,
        rate_hz: float | None = None,
        log_level: str = "warning",
    ) -> None:
        arguments = [
            "--sensor",
            sensor,
            "--link",
            "pty" if _has_ptys() else "tcp:127.0.0.1:0",
            "--log-level",
            log_level,
        ]
        if frames is not None:
            arguments += ["--frames", str(frames)]
        if rate_hz is not None:
            arguments += ["--rate", f"{rate_hz:g}"]
        if lossless:
            arguments.append("--lossless")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "prismstereo.simulated_firmware", *arguments],
            stdin=subprocess.PIPE,  # its end is the firmware's, should this process be killed
            stdout=subprocess.PIPE,
            text=True,
        )
        self.statistics: dict[str, object] = {}
        try:
            self.address = str(self._line(_START_S)["listening"])
        except BaseException:
            self.stop()
            raise

    def _output(self) -> IO[str]:
        assert self._process.stdout is not None
        return self._process.stdout

    def _line(self, timeout_s: float) -> dict[str, object]:
        with selectors.DefaultSelector() as selector:
            selector.register(self._output(), selectors.EVENT_READ)
            ready = selector.select(timeout_s)
        text = self._output().readline() if ready else ""
        try:
            line = json.loads(text)
            assert isinstance(line, dict)
        except (ValueError, AssertionError):
            raise DeviceError(
                f"the simulated device did not start (exit code {self._process.poll()}): run `prismstereo-device` by hand "
                "to see why"
            ) from None
        return line

    def stop(self) -> None:
        """End the firmware and keep its counters."""
        if self._process.poll() is None:
            self._process.terminate()
        try:
            rest, _ = self._process.communicate(timeout=_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            rest, _ = self._process.communicate()
        for text in (rest or "").splitlines():
            if text.startswith('{"statistics"'):
                self.statistics = json.loads(text)["statistics"]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


def _has_ptys() -> bool:
    try:
        device, host = os.openpty()
    except (AttributeError, OSError):
        return False
    os.close(device)
    os.close(host)
    return True
