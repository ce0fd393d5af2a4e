"""The compiled sweeps beside a plain reference, and the same bits from any number of threads and any processor."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import zlib
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from device.shifted_noise import grey, noise
from device.tile_reference import allowed, costs, decided, path_sums
from prismstereo_device.match.base import Found, Search
from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.level import MARGINS, Level, Penalties
from prismstereo_device.match.tiles.path_kernels import LABEL_BYTES
from prismstereo_device.match.tiles.pyramid import NO_HINT, Pyramid
from prismstereo_device.match.tiles.semiglobal import SemiglobalMatcher
from prismstereo_device.match.tiles.speckle_kernels import clear_small, find_runs, join_rows
from prismstereo_device.match.tiles.tiles import TilesMatcher

PRICES = Penalties()


def swept(left: np.ndarray, right: np.ndarray, labels: int, lists: list[list[int]] | None, workers: int = 1) -> Pyramid:
    """One level, swept with these lists."""
    level = Level(*left.shape, labels, None if lists is None else labels, workers)
    for tile, names in enumerate(lists or []):
        start = level.lists.starts[tile]
        level.lists.labels[start : start + len(names)] = names
        level.lists.counts[tile], level.lists.known[tile] = len(names), 1
    if lists is not None:
        sizes = level.lists.counts * LABEL_BYTES
        level.lists.volumes[:] = np.cumsum(sizes) - sizes
    pyramid = Pyramid([level], workers, PRICES)
    pyramid.steps(left, right, 0, NO_HINT)
    return pyramid


def random_pair(rng: np.random.Generator, height: int, width: int, labels: int) -> tuple[np.ndarray, np.ndarray]:
    """A pair whose disparity changes from block to block, with noise."""
    right = grey(noise(rng, height, width + labels))
    steps = cv2.resize(rng.integers(0, labels, (4, 5)).astype(np.float32), (width, height), interpolation=0)
    columns = np.arange(width) + labels - steps.astype(int)
    left = np.take_along_axis(right, columns, axis=1)
    return np.clip(left + rng.normal(0, 2, left.shape), 0, 255).astype(np.uint8), np.ascontiguousarray(
        right[:, labels:]
    )


@pytest.mark.parametrize(("height", "width", "labels"), [(70, 101, 9), (33, 64, 40), (64, 37, 3)])
def test_sweeps_over_lists_give_what_a_plain_reference_gives(
    height: int, width: int, labels: int, rng: np.random.Generator
) -> None:
    left, right = random_pair(rng, height, width, labels)
    tiles = -(-height // TILE) * -(-width // TILE)
    lists = [sorted(rng.choice(labels, rng.integers(1, labels + 1), replace=False).tolist()) for _ in range(tiles)]
    has = allowed(lists, height, width, labels)
    sums = path_sums(costs(left, right, labels), has, left, PRICES)
    winner, lead = decided(sums, has)

    level = swept(left, right, labels, lists).finest

    np.testing.assert_array_equal(level.winner[:height, :width], winner)
    np.testing.assert_array_equal(level.margin[:height, :width], lead)


def test_lists_of_all_labels_give_the_semiglobal_map_bit_for_bit(rng: np.random.Generator) -> None:
    left, right = random_pair(rng, 110, 145, 24)
    every = [list(range(24))] * (4 * 5)
    of_lists, of_all = swept(left, right, 24, every), swept(left, right, 24, None)
    np.testing.assert_array_equal(of_lists.finest.disparity, of_all.finest.disparity)
    whole = SemiglobalMatcher().search(left, right, Search(24))
    np.testing.assert_array_equal(of_lists.finish(0)[0], whole.disparity_px)


def test_paths_walked_in_stages_are_the_same_as_in_one(rng: np.random.Generator) -> None:
    left, right = random_pair(rng, 40, 280, 30)
    some = [list(range(30))] * (2 * 9)
    one = swept(left, right, 30, some)
    many = swept(left, right, 30, some)
    desk = many._desks[0]
    held = desk.walk[6]
    desk.walk = (*desk.walk[:6], held[: 30 * TILE * 2 * TILE], *desk.walk[7:])  # room for a single tile
    many.steps(left, right, 0, NO_HINT)
    np.testing.assert_array_equal(many.finest.disparity, one.finest.disparity)


def same(one: Found, other: Found) -> bool:
    return all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in (
            (one.disparity_px, other.disparity_px),
            (one.confidence, other.confidence),
            (one.reasons, other.reasons),
        )
    )


@pytest.mark.parametrize("matcher", [TilesMatcher, SemiglobalMatcher])
@pytest.mark.parametrize(("labels", "first"), [(24, 0), (300, 5)])
def test_any_number_of_threads_gives_the_same_bits(
    matcher: type[TilesMatcher | SemiglobalMatcher], labels: int, first: int, rng: np.random.Generator
) -> None:
    left, right = random_pair(rng, 130, 197, 24)
    alone = matcher().search(left, right, Search(labels, first, threads=1))
    assert np.isfinite(alone.disparity_px).mean() > 0.5
    for threads in (2, 3, 64):
        assert same(alone, matcher().search(left, right, Search(labels, first, threads=threads)))


def fingerprint(left: np.ndarray, right: np.ndarray) -> int:
    found = TilesMatcher().search(left, right, Search(24, threads=2))
    assert found.confidence is not None
    assert found.reasons is not None
    maps = found.disparity_px, found.confidence, found.reasons
    return zlib.crc32(b"".join(values.tobytes() for values in maps))


PRINT_FINGERPRINT = """
import sys
import numpy as np
from device.test_tiles_kernels import fingerprint
from prismstereo_device.match.tiles.lanes import LANES
print(LANES, fingerprint(*np.load(sys.argv[1])))
"""


@pytest.mark.soak  # compiles everything anew for each of them
@pytest.mark.skipif(platform.machine() != "x86_64", reason="names of x86 processors")
@pytest.mark.parametrize(("processor", "lanes"), [("nehalem", 16), ("haswell", 32)])
def test_older_processors_give_the_same_bits(
    processor: str, lanes: int, tmp_path: Path, rng: np.random.Generator
) -> None:
    pair = random_pair(rng, 75, 110, 24)
    np.save(tmp_path / "pair.npy", np.stack(pair))
    environment = os.environ | {"NUMBA_CPU_NAME": processor, "PYTHONPATH": os.pathsep.join(sys.path)}
    program = [sys.executable, "-c", PRINT_FINGERPRINT, str(tmp_path / "pair.npy")]
    printed = subprocess.run(program, env=environment, capture_output=True, text=True, check=True).stdout.split()
    assert printed == [str(lanes), str(fingerprint(*pair))]


def test_where_no_folder_can_be_written_the_kernels_are_compiled_in_memory() -> None:
    program = """
import os, numba
from numba.core import caching
for name in dir(caching):
    found = getattr(caching, name)
    if isinstance(found, type) and issubclass(found, caching._CacheLocator):
        found.from_function = classmethod(lambda cls, function, file: None)
from prismstereo_device.compiled import compiled
print(compiled(lambda x: x + 1)(1))
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "2"


def test_small_islands_are_those_of_opencv(rng: np.random.Generator) -> None:
    height, width, strips = 90, 133, 3
    steps = cv2.resize(rng.integers(0, 60, (30, 40)).astype(np.float32), (width, height)).astype(np.int16) * 3
    steps[rng.random((height, width)) < 0.25] = -16
    framed = np.full((height + 4, 160 + 2 * TILE), -16, np.int16)
    framed[2:-2, TILE : TILE + width] = steps
    islands = [np.zeros(height * width + 1, np.int32) for _ in range(4)]
    rows = np.zeros(2 * (height + 1), np.int32)
    cuts = [height * strip // strips for strip in range(strips + 1)]
    for begin, end in pairwise(cuts):
        find_runs(framed, MARGINS, width, begin, end, begin * width, *islands, rows)
    for y in cuts[1:-1]:
        later = height + 1
        join_rows(framed, MARGINS, y, rows[y - 1], rows[later + y - 1], rows[y], rows[later + y], *islands)
    for begin, end in pairwise(cuts):
        clear_small(framed, MARGINS, begin, end, *islands, rows, 30, -16)

    cv2.filterSpeckles(steps, -16, 29, 16)
    np.testing.assert_array_equal(framed[2:-2, TILE : TILE + width], steps)
    assert 0.05 < (steps < 0).mean() < 0.95
