"""Both disparity codecs against PNG, zstd, JPEG-LS and FFV1, at 640 x 720: milliseconds and bits per pixel.

Peers round as codec 2 does: the map is quantised to the same bound first, JPEG-LS has a bound of its own. With PRISMSTEREO_DATA
set, real maps follow: the group's mean bits per pixel and frames a second of processor time, and the times of its first map.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.row import BenchRow, interleave
from device.disparity_corpus import FITTED
from prismstereo_device import codec
from prismstereo_device.codec import compact
from sgbm_anchor import sgbm_anchor

HEIGHT, WIDTH = 720, 640
LABELS = 96

Map = NDArray[np.uint16]


def matched_map() -> Map:
    """Match a textured scene of slanted planes by SGBM: (720, 640) uint16 sixteenths with real matching noise."""
    random = np.random.default_rng(2)
    texture = sum(
        cv2.resize(random.normal(size=(HEIGHT // size, WIDTH // size)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        for size in (1, 2, 5, 16)
    )
    left = np.clip(128 + 28 * texture, 0, 255).astype(np.uint8)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    box = (abs(columns - 380) < 110) & (abs(rows - 330) < 150)
    truth = np.where(box, 62 - 0.02 * rows, 18 + 0.03 * columns + 0.01 * rows).astype(np.float32)
    right = cv2.remap(left, columns + truth, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    noise = random.normal(0, 2.0, (2, HEIGHT, WIDTH))
    views = [np.clip(view + grain, 0, 255).astype(np.uint8) for view, grain in zip((left, right), noise, strict=True)]
    matcher = sgbm_anchor(LABELS)
    return np.maximum(matcher.compute(*views), 0).astype(np.uint16)


def heights(shape: tuple[int, ...]) -> list[int]:
    """Give the rows of each stripe of a map."""
    rows = codec.rows_per_stripe(shape[1])
    return [min(rows, shape[0] - top) for top in range(0, shape[0], rows)]


def decode(stripes: list[bytes], shape: tuple[int, ...]) -> Map:
    """Restore a whole map of codec 1."""
    parts = zip(stripes, heights(shape), strict=True)
    return np.concatenate([codec.decode_stripe(stripe, rows, shape[1]) for stripe, rows in parts])


def decode_compact(encoded: compact.EncodedMap, shape: tuple[int, ...], bound: int) -> Map:
    """Restore a whole map of codec 2, its tables included."""
    tables = compact.Tables.read(encoded.tables, bound)
    parts = zip(encoded.stripes, heights(shape), strict=True)
    return np.concatenate([compact.decode_stripe(stripe, rows, shape[1], bound, tables) for stripe, rows in parts])


def quantised(steps: Map, bound: int) -> Map:
    """Round to multiples of 2 * bound + 1, in numbers of them plus one; 0 stays 0."""
    step = 2 * bound + 1
    return np.where(steps == 0, 0, (steps.astype(np.int32) + bound) // step + 1).astype(np.uint16)


def ffv1(steps: Map) -> bytes:
    """Compress one key frame of 16-bit grey by FFV1 level 3 on one thread."""
    av: Any = import_module("av")
    context = av.CodecContext.create("ffv1", "w")
    context.width, context.height, context.pix_fmt = steps.shape[1], steps.shape[0], "gray16le"
    context.time_base, context.thread_count = Fraction(1, 30), 1
    context.options = {"level": "3"}
    packets = context.encode(av.VideoFrame.from_ndarray(steps, format="gray16le")) + context.encode(None)
    return b"".join(map(bytes, packets))


def png(steps: Map) -> bytes:
    """Compress to a 16-bit PNG."""
    return bytes(cv2.imencode(".png", steps)[1])


def peers(bound: int) -> dict[str, Callable[[Map], bytes]]:
    """Give what can be compared with here, by name: each turns a map into bytes within the bound."""
    known: dict[str, Callable[[Map], bytes]] = {
        "zstd (codec 1)": lambda steps: b"".join(codec.encode(quantised(steps, bound))),
        "16-bit PNG (OpenCV)": lambda steps: png(quantised(steps, bound)),
    }
    if find_spec("imagecodecs"):
        encode: Any = import_module("imagecodecs").jpegls_encode
        known["JPEG-LS (CharLS)"] = lambda steps: bytes(encode(steps, level=bound))
    if find_spec("av"):
        known["FFV1 (FFmpeg)"] = lambda steps: ffv1(quantised(steps, bound))
    return known


def rate_hz(works: Sequence[Callable[[], object]], rounds: int = 15) -> float:
    """Give how many of the works a second of processor time holds, from the least time of each: neighbours only add to it."""
    times = np.empty((rounds, len(works)))
    for turn in times:
        for index, work in enumerate(works):
            begin = time.thread_time()
            work()
            turn[index] = time.thread_time() - begin
    return 1 / float(times.min(axis=0).mean())


def bits(size: int, steps: Map) -> float:
    """Give bits per pixel."""
    return 8 * size / steps.size


def measure() -> list[BenchRow]:
    """Time encoding and decoding in turn with the peers; every map must come back within its bound."""
    steps = matched_map()
    stripes, picture = codec.encode(steps), cv2.imencode(".png", steps)[1]
    assert np.array_equal(decode(stripes, steps.shape), steps)
    density = f"{100 * np.count_nonzero(steps) / steps.size:.0f} % matched"
    size = f"{bits(sum(map(len, stripes)), steps):.2f} bits per pixel, PNG {bits(picture.size, steps):.2f}; {density}"
    encoding = interleave(lambda: codec.encode(steps), lambda: cv2.imencode(".png", steps))
    decoding = interleave(lambda: decode(stripes, steps.shape), lambda: cv2.imdecode(picture, cv2.IMREAD_UNCHANGED))
    rows = [
        BenchRow("codec 1 encodes, 640x720", encoding[0], "16-bit PNG (OpenCV)", encoding[1], size),
        BenchRow("codec 1 decodes, 640x720", decoding[0], "16-bit PNG (OpenCV)", decoding[1], size),
    ]
    rows += [row for bound in compact.BOUNDS for row in _compact_rows(steps, bound)]
    data = os.environ.get("PRISMSTEREO_DATA")
    return rows + (_real_rows(Path(data)) if data else [])


def _real_rows(data: Path) -> list[BenchRow]:
    rows = []
    for name, read in FITTED.items():
        maps = read(data)
        for bound in compact.BOUNDS:
            rows += _group_rows(name, maps, bound)
    return rows


def _group_rows(name: str, maps: list[Map], bound: int) -> list[BenchRow]:
    """Compare one group of real maps with every peer; each map must come back within its bound."""
    packed = [compact.encode_stripes(steps, bound) for steps in maps]
    for steps, encoded in zip(maps, packed, strict=True):
        restored = decode_compact(encoded, steps.shape, bound)
        assert np.array_equal(restored == 0, steps == 0)
        assert np.abs(restored.astype(int) - steps).max() <= bound
    first = maps[0]
    size = np.mean([bits(encoded.size, steps) for encoded, steps in zip(packed, maps, strict=True)])
    writing = rate_hz([partial(compact.encode_stripes, steps, bound) for steps in maps])
    reading = rate_hz([partial(decode_compact, encoded, first.shape, bound) for encoded in packed])
    rows = []
    for peer, compress in peers(bound).items():
        theirs = np.mean([bits(len(compress(steps)), steps) for steps in maps])
        times = interleave(lambda: compact.encode_stripes(first, bound), lambda work=compress: work(first), rounds=3)
        note = f"{size:.3f} bits per pixel, peer {theirs:.3f}; {writing:.0f} frames/s out, {reading:.0f} in"
        rows.append(BenchRow(f"codec 2 within {bound}/16 px, {name}", times[0], peer, times[1], note))
    return rows


def _compact_rows(steps: Map, bound: int) -> list[BenchRow]:
    encoded = compact.encode_stripes(steps, bound)
    restored = decode_compact(encoded, steps.shape, bound)
    assert np.array_equal(restored == 0, steps == 0)
    assert np.abs(restored.astype(int) - steps).max() <= bound
    name, size, rows = f"within {bound}/16 px", bits(encoded.size, steps), []
    for peer, compress in peers(bound).items():
        note = f"{size:.2f} bits per pixel, peer {bits(len(compress(steps)), steps):.2f}"
        ours, theirs = interleave(lambda: compact.encode_stripes(steps, bound), lambda work=compress: work(steps))
        rows.append(BenchRow(f"codec 2 encodes {name}, 640x720", ours, peer, theirs, note))
    picture = cv2.imencode(".png", quantised(steps, bound))[1]
    ours, theirs = interleave(
        lambda: decode_compact(encoded, steps.shape, bound), lambda: cv2.imdecode(picture, cv2.IMREAD_UNCHANGED)
    )
    return [*rows, BenchRow(f"codec 2 decodes {name}, 640x720", ours, "16-bit PNG (OpenCV)", theirs, f"{size:.2f} bpp")]
