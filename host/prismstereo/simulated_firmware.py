"""The firmware's program for a simulated sensor: `prismstereo-device`, which ends when whoever started it is gone.

A firmware by itself waits for the next host for ever; one that a program started for itself has no other.
"""

from __future__ import annotations

import os
import signal
import sys
import threading

from prismstereo_device.__main__ import main

__all__ = ["run"]


def run(arguments: list[str]) -> None:
    """Run the firmware until it ends, or until standard input does."""
    threading.Thread(target=_end_with_input, name="prismstereo-parent", daemon=True).start()
    main(arguments)


def _end_with_input() -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    run(sys.argv[1:])
