"""A map of 640x853 onto a still of 2376x3168, beside OpenCV's joint bilateral filter and its other guided filters.

The peers run in a process of their own, see `contrib_peers`; rounds alternate with ours. Without them, and without real data
(PRISMSTEREO_DATA), there is nothing to compare on. Input is a clean map; ours returns into buffers that are kept.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.contrib_peers import VARIABLE, ContribPeers, contrib_python
from benchmarks.row import BenchRow
from host.fusion_scores import point_sampled
from prismstereo.fusion.upsampling import EdgeSnap, Grid, upsample

SIZE = (3168, 2376)
SCALE = 3.7125
ROUNDS = 7
SLOW_ROUNDS = 3


def measure() -> list[BenchRow]:
    data, python = os.environ.get("PRISMSTEREO_DATA"), contrib_python()
    if data is None or python is None:
        print(f"upsample: left out, set PRISMSTEREO_DATA and {VARIABLE}", file=sys.stderr)
        return []
    low, guide = _mosaic(Path(data) / "sr-moebius-full/full")
    with tempfile.TemporaryDirectory() as folder, ContribPeers(python, Path(folder)) as peers:
        names = peers.load(low, guide)
        snap = EdgeSnap(low.shape, SIZE, 3, Grid.between(low.shape, SIZE))
        votes = EdgeSnap(low.shape, SIZE, 3, Grid.between(low.shape, SIZE), learned=False)
        rows = [
            _row("edge-snap, 2376x3168", snap, low, guide, peers, names[0], ROUNDS),
            _row("votes, 2376x3168", votes, low, guide, peers, names[0], ROUNDS),
        ]
        rows += [_row("edge-snap, 2376x3168", snap, low, guide, peers, name, SLOW_ROUNDS) for name in names[1:]]
        return [*rows, *_others(low, guide, peers, names[0])]


def _row(
    name: str,
    snap: EdgeSnap,
    low: NDArray[np.float32],
    guide: NDArray[np.uint8],
    peers: ContribPeers,
    peer: str,
    rounds: int,
) -> BenchRow:
    kept = snap.upsample(low, guide)
    peers.run(peer)
    ours_ms, peer_ms = [], []
    for _ in range(rounds):
        begin = time.perf_counter()
        snap.upsample(low, guide, kept)
        ours_ms.append(1e3 * (time.perf_counter() - begin))
        peer_ms.append(peers.run(peer))
    note = f"least {min(ours_ms):.1f} and {min(peer_ms):.0f} ms"
    return BenchRow(name, statistics.median(ours_ms), peer, statistics.median(peer_ms), note)


def _others(low: NDArray[np.float32], guide: NDArray[np.uint8], peers: ContribPeers, peer: str) -> list[BenchRow]:
    """Time our other methods, each once after a warm-up."""
    rows = []
    for method in ("geodesic", "joint-bilateral", "weighted-mode"):
        upsample(low, guide, method)
        begin = time.perf_counter()
        upsample(low, guide, method)
        rows.append(BenchRow(f"{method}, 2376x3168", 1e3 * (time.perf_counter() - begin), peer, peers.run(peer)))
    return rows


def _mosaic(folder: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Repeat a real scene, mirrored, until it is as large as a still; return the map of its truth, no holes, and the guide."""
    guide = cv2.imread(str(folder / "moebius_color_1390x1110.png"))[11 : 11 + 1088, 7 : 7 + 1376]
    truth = cv2.imread(str(folder / "moebius_disp_1376x1088.png"), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    wide = [np.concatenate([picture, picture[:, ::-1]], axis=1) for picture in (guide, truth)]
    guide, truth = (np.concatenate([picture, picture[::-1], picture])[: SIZE[0], : SIZE[1]] for picture in wide)
    low = point_sampled(np.where(truth > 0, truth, np.nan), SCALE)[0]
    known = np.isfinite(low)
    low[~known] = np.interp(np.flatnonzero(~known), np.flatnonzero(known), low[known])
    return low, np.ascontiguousarray(guide)
