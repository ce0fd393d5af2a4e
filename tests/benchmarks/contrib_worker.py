"""OpenCV's contributed filters as peers of the upsampler: a process of its own, in an environment that has them.

Started with a folder as its argument; told by lines on stdin. `load FILE` takes `low` (h, w), float32 pixels of its own, no
holes, and `guide` (H, W, 3) uint8 of an npz file. `run NAME` does a peer's whole work, from `low` to still size, and answers
with milliseconds. `keep NAME` does the same and writes the result to kept.npy in the folder. Needs numpy and cv2.ximgproc only.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

THREADS = 2
SEED = 1  # the weighted median draws clusters of colours at random


class Peers:
    """All peers on one pair of map and guide."""

    def __init__(self, low: np.ndarray, guide: np.ndarray) -> None:
        self.low, self.guide = low, guide
        self.size = guide.shape[1], guide.shape[0]
        self.scale = guide.shape[1] / low.shape[1]

    def grey(self) -> np.ndarray:
        return cv2.cvtColor(self.guide, cv2.COLOR_BGR2GRAY)

    def bilinear(self) -> np.ndarray:
        return cv2.resize(self.low * np.float32(self.scale), self.size, interpolation=cv2.INTER_LINEAR)

    def nearest(self) -> np.ndarray:
        rows, columns = (
            np.clip(np.floor((np.arange(many) + 0.5) * few / many), 0, few - 1).astype(int)
            for many, few in zip(self.size[::-1], self.low.shape, strict=True)
        )
        return self.low[rows][:, columns] * np.float32(self.scale)

    def joint_bilateral(self, start: np.ndarray, d: int, colour: float, space: float) -> np.ndarray:
        return cv2.ximgproc.jointBilateralFilter(self.grey().astype(np.float32), start, d, colour, space)

    def sparse(self, strength: float, colour: float) -> np.ndarray:
        """The global smoother on the sites alone, divided by what it makes of their mask."""
        mask = np.zeros(self.size[::-1], np.float32)
        values = mask.copy()
        rows, columns = (
            np.clip(np.rint((np.arange(few) + 0.5) * many / few - 0.5), 0, many - 1).astype(int)
            for many, few in zip(self.size[::-1], self.low.shape, strict=True)
        )
        mask[np.ix_(rows, columns)] = 1
        values[np.ix_(rows, columns)] = self.low * np.float32(self.scale)
        smoother = cv2.ximgproc.createFastGlobalSmootherFilter(self.guide, strength, colour)
        return smoother.filter(values) / np.maximum(smoother.filter(mask), 1e-9)

    def weighted_median(self, sites: float, sigma: float) -> np.ndarray:
        cv2.setRNGSeed(SEED)
        return cv2.ximgproc.weightedMedianFilter(self.guide, self.nearest(), round(sites * self.scale), sigma)

    def least_squares(self, strength: float, colour: float) -> np.ndarray:
        smoother = cv2.ximgproc.createDisparityWLSFilterGeneric(use_confidence=False)
        smoother.setLambda(strength)
        smoother.setSigmaColor(colour)
        steps = np.rint(self.bilinear() * 16).astype(np.int16)
        return smoother.filter(steps, self.guide).astype(np.float32) / 16

    def named(self) -> dict[str, Callable[[], np.ndarray]]:
        """Each peer in its usual setting and in such as are good at depth edges."""
        s = self.scale
        guided = cv2.ximgproc.guidedFilter
        return {
            "joint bilateral, usual (d17)": lambda: self.joint_bilateral(self.bilinear(), 17, 12.0, 3.7),
            "joint bilateral, tuned (d11)": lambda: self.joint_bilateral(self.nearest(), 11, 3.0, 0.4 * s),
            "guided, grey": lambda: guided(self.grey(), self.bilinear(), round(2 * s), 100.0),
            "guided, colour": lambda: guided(self.guide, self.nearest(), round(s), 25.0),
            "global smoother": lambda: self.sparse(100.0, 5.0),
            "global smoother, tuned": lambda: self.sparse(10.0, 3.0),
            "weighted median": lambda: self.weighted_median(2, 25.5),
            "weighted median, tuned": lambda: self.weighted_median(1, 12.0),
            "WLS": lambda: self.least_squares(8000.0, 1.5),
            "WLS, tuned": lambda: self.least_squares(300.0, 0.8),
        }


def main(folder: Path) -> None:
    cv2.setNumThreads(THREADS)
    peers = None
    print("ready", cv2.__version__, flush=True)
    for line in sys.stdin:
        verb, _, name = line.rstrip("\n").partition(" ")
        if verb == "load":
            with np.load(name) as held:
                peers = Peers(held["low"], held["guide"])
            print("; ".join(peers.named()), flush=True)
            continue
        assert peers is not None
        begin = time.perf_counter()
        found = peers.named()[name]()
        milliseconds = 1e3 * (time.perf_counter() - begin)
        if verb == "keep":
            np.save(folder / "kept.npy", found)
        print(f"{milliseconds:.3f}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
