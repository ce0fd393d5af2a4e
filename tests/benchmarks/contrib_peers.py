"""Talks to `contrib_worker.py`, which runs in an environment with opencv-contrib-python-headless and numpy.

PRISMSTEREO_CONTRIB_PYTHON names that environment's Python; this project's own has OpenCV without the contributed filters.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

__all__ = ["VARIABLE", "ContribPeers", "contrib_python"]

VARIABLE = "PRISMSTEREO_CONTRIB_PYTHON"
_WORKER = Path(__file__).with_name("contrib_worker.py")


def contrib_python() -> Path | None:
    """Return the Python that has the peers, None where nobody names one."""
    named = os.environ.get(VARIABLE)
    return Path(named) if named and Path(named).exists() else None


class ContribPeers:
    """The peers in their own process; `with` starts and ends it. `folder` is for what goes between."""

    def __init__(self, python: Path, folder: Path) -> None:
        self._command = [str(python), str(_WORKER), str(folder)]
        self._folder = folder

    def __enter__(self) -> ContribPeers:
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._answer()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate()

    def load(self, low: NDArray[np.float32], guide: NDArray[np.uint8]) -> list[str]:
        """Hand over a map without holes and a guide; return the peers' names."""
        path = self._folder / "pair.npz"
        np.savez(path, low=low, guide=guide)
        return self._ask(f"load {path}").split("; ")

    def run(self, name: str) -> float:
        """Let a peer work; return the milliseconds it says it took."""
        return float(self._ask(f"run {name}"))

    def result(self, name: str) -> NDArray[np.float32]:
        """Let a peer work; return its map."""
        self._ask(f"keep {name}")
        return np.asarray(np.load(self._folder / "kept.npy"), np.float32)

    def _ask(self, line: str) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        return self._answer()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(
                f"{' '.join(self._command)} ended: is opencv-contrib-python-headless in that environment?"
            )
        return line.rstrip("\n")
