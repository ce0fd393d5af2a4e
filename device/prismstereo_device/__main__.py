"""The firmware's program: `prismstereo-device --sensor twin:oak-1 --link pty`.

Standard output carries two lines of JSON: where it listens, and, at the end, the counters. Logs go to standard error.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from prismstereo_device.program.options import read_options
from prismstereo_device.program.starting import serve, what_would_run
from prismstereo_device.serving.log_ring import LogRing
from prismstereo_hw.errors import PrismStereoError

__all__ = ["REBOOT", "main"]

REBOOT = 75  # exit code: start it again, a host asked for it; the service manager does so whatever its other rules


def main(arguments: list[str] | None = None) -> None:
    """Run the firmware until its link or its sensor ends, or it is told to stop."""
    try:
        asked = read_options(arguments)
        if asked.check:
            print(json.dumps(what_would_run(asked.configuration), indent=2))
            return
        with _logging(asked.configuration.log_level) as ring:
            if serve(asked.configuration, ring, _tell):
                sys.exit(REBOOT)
    except PrismStereoError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)


class _OneSentence(logging.Formatter):
    """Writes a record in one line; what went wrong by its own sentence, without a traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """Write one record."""
        line = f"{record.levelname} {record.name}: {record.getMessage()}"
        wrong = record.exc_info[1] if record.exc_info else None
        return line if wrong is None else f"{line}: {wrong}"


@contextmanager
def _logging(level: str) -> Iterator[LogRing]:
    """Log to standard error from this level on, and from INFO on to the lines that a host can read."""
    root, ring, console = logging.getLogger(), LogRing(), logging.StreamHandler(sys.stderr)
    console.setLevel(level.upper())
    console.setFormatter(_OneSentence())
    before = root.level
    root.setLevel(min(logging.INFO, console.level))
    handlers: tuple[logging.Handler, ...] = (ring, console)
    for handler in handlers:
        root.addHandler(handler)
    try:
        yield ring
    finally:
        root.setLevel(before)
        for handler in handlers:
            root.removeHandler(handler)


def _tell(line: dict[str, object]) -> None:
    try:
        print(json.dumps(line), flush=True)
    except BrokenPipeError:  # whoever started us is gone; the counters have no reader
        sys.stdout = sys.stderr


if __name__ == "__main__":
    main()
