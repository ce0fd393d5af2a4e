"""A program of ours in a process of its own, spoken to in lines of JSON."""

from __future__ import annotations

import contextlib
import json
import selectors
import subprocess
import sys
from types import TracebackType
from typing import IO, Self

from prismstereo_hw.errors import DeviceError

__all__ = ["Child"]

_START_S = 60.0
_ANSWER_S = 10.0
_STOP_S = 10.0


class Child:
    """Runs a module with one JSON argument; it ends when its standard input does.

    `first` is the line that it said once it was ready. Raises DeviceError where it does not get that far.
    """

    def __init__(self, module: str, wish: dict[str, object]) -> None:
        self._module = module
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, json.dumps(wish)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        try:
            self.first = self._line(_START_S)
        except BaseException:
            self.kill()
            raise

    def ask(self, question: dict[str, object]) -> dict[str, object]:
        """Send a line and wait for the answer. Raises DeviceError where none comes."""
        pipe = self._pipe(self._process.stdin)
        with contextlib.suppress(BrokenPipeError):  # it died; the missing answer says so
            pipe.write(json.dumps(question) + "\n")
            pipe.flush()
        return self._line(_ANSWER_S)

    def stop(self) -> None:
        """Let it end by itself; it is killed where it does not."""
        with contextlib.suppress(BrokenPipeError):
            self._pipe(self._process.stdin).close()
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._end()

    def kill(self) -> None:
        """End it at once, as a power cut would."""
        self._process.kill()
        self._end()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _end(self) -> None:
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(BrokenPipeError):
                self._pipe(pipe).close()

    def _line(self, timeout_s: float) -> dict[str, object]:
        output = self._pipe(self._process.stdout)
        with selectors.DefaultSelector() as selector:
            selector.register(output, selectors.EVENT_READ)
            ready = selector.select(timeout_s)
        text = output.readline() if ready else ""
        if not text:
            raise DeviceError(
                f"the process {self._module} does not answer (exit code {self._process.poll()}): what it wrote to standard "
                "error says why"
            )
        line = json.loads(text)
        assert isinstance(line, dict)
        return line

    def _pipe(self, pipe: IO[str] | None) -> IO[str]:
        assert pipe is not None
        return pipe
