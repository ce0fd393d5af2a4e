"""Codec 2: exact or within its bound, the mask always exact; no bytes break it, no damage passes it."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from device import codec_reference
from device.test_codec import ANY_STEP, MAPS, slanted_scene
from prismstereo_device import codec
from prismstereo_device.codec.compact import BOUNDS, EncodedMap, Tables, decode_stripe, encode_stripes
from prismstereo_device.wire import LIMITS, WireError
from prismstereo_hw.errors import UsageError

Map = NDArray[np.uint16]
VECTORS = json.loads((Path(__file__).parent / "codec_vectors.json").read_text())


@pytest.fixture(scope="module", autouse=True)
def _tables_of_every_bound() -> None:
    for bound in BOUNDS:
        Tables.frozen(bound)


def decoded(encoded: EncodedMap, shape: tuple[int, ...], bound: int) -> Map:
    tables, rows = Tables.read(encoded.tables, bound), codec.rows_per_stripe(shape[1])
    return np.concatenate(
        [
            decode_stripe(stripe, min(rows, shape[0] - top * rows), shape[1], bound, tables)
            for top, stripe in enumerate(encoded.stripes)
        ]
    )


def assert_faithful(steps: Map, bound: int, tables: Tables | None = None) -> None:
    restored = decoded(encode_stripes(steps, bound, tables), steps.shape, bound)
    np.testing.assert_array_equal(restored == 0, steps == 0)
    assert np.abs(restored.astype(int) - steps).max() <= bound


@pytest.mark.parametrize("bound", BOUNDS)
@pytest.mark.parametrize("steps", MAPS.values(), ids=MAPS.keys())
def test_a_map_comes_back_within_the_bound_and_its_mask_exactly(steps: Map, bound: int) -> None:
    assert_faithful(steps, bound)
    assert_faithful(steps, bound, Tables.frozen(bound))


@settings(deadline=None, max_examples=60)
@given(
    hnp.arrays(np.uint16, hnp.array_shapes(min_dims=2, max_dims=2, max_side=40), elements=ANY_STEP),
    st.sampled_from(BOUNDS),
)
def test_any_map_comes_back_within_the_bound(steps: Map, bound: int) -> None:
    assert_faithful(steps, bound)


def test_the_frozen_tables_are_those_of_the_specification() -> None:
    for bound in BOUNDS:
        entries = Tables.frozen(bound).entries.astype("<u4").tobytes()
        assert hashlib.sha256(entries).hexdigest() == VECTORS["frozen_tables_sha256"][str(bound)]


@pytest.mark.parametrize("vector", VECTORS["vectors"], ids=lambda vector: vector["name"])
def test_the_vectors_of_the_specification_hold(vector: dict[str, object]) -> None:
    steps, restored = (np.array(vector[name], np.uint16) for name in ("pixels", "restored"))
    bound = int(str(vector["bound"]))
    encoded = encode_stripes(steps, bound, Tables.read(bytes.fromhex(str(vector["tables"])), bound))
    assert [stripe.hex() for stripe in encoded.stripes] == vector["stripes"]
    np.testing.assert_array_equal(decoded(encoded, steps.shape, bound), restored)


def small_maps(count: int) -> Iterator[tuple[Map, int]]:
    """Pieces of scenes, holes, noise and extremes, of all small shapes."""
    random = np.random.default_rng(6)
    scene = slanted_scene()
    for number in range(count):
        height, width = random.integers(1, 24, 2)
        top, left = random.integers(0, 140, 2)
        steps = scene[top : top + height, left : left + width].copy()
        if number % 4 == 1:
            steps[random.random(steps.shape) < 0.4] = 0
        if number % 4 == 2:
            steps = random.integers(0, 65536, steps.shape, dtype=np.uint16)
        if number % 4 == 3:
            steps += random.integers(0, 2, steps.shape, dtype=np.uint16) * np.uint16(4000)
        yield steps, BOUNDS[number // 4 % 4]


def test_the_reference_reads_two_hundred_maps_pixel_for_pixel() -> None:
    own = 0
    for steps, bound in small_maps(200):
        encoded = encode_stripes(steps, bound)
        own += bool(encoded.tables)
        height, width = steps.shape
        parts = [
            codec_reference.decode(stripe, min(16, height - 16 * top), width, bound, encoded.tables)
            for top, stripe in enumerate(encoded.stripes)
        ]
        assert list(chain.from_iterable(parts)) == decoded(encoded, steps.shape, bound).ravel().tolist()
    assert own > 20


@pytest.mark.parametrize("bound", BOUNDS)
@pytest.mark.parametrize("name", [name for name, steps in MAPS.items() if steps.size < 2000])
def test_the_reference_reads_the_extremes_pixel_for_pixel(name: str, bound: int) -> None:
    steps = MAPS[name]
    height, width = steps.shape
    encoded = encode_stripes(steps, bound)
    parts = [
        codec_reference.decode(stripe, min(16, height - 16 * top), width, bound, encoded.tables)
        for top, stripe in enumerate(encoded.stripes)
    ]
    assert list(chain.from_iterable(parts)) == decoded(encoded, steps.shape, bound).ravel().tolist()


def test_the_reference_reads_the_tables_of_a_whole_scene() -> None:
    steps = slanted_scene()
    for bound in BOUNDS:
        encoded = encode_stripes(steps, bound)
        assert encoded.tables
        first = codec_reference.decode(encoded.stripes[0], 16, steps.shape[1], bound, encoded.tables)
        assert first == decoded(encoded, steps.shape, bound)[:16].ravel().tolist()


def test_stripes_do_not_depend_on_one_another() -> None:
    steps = slanted_scene()
    other = steps.copy()
    other[16:32] = 0
    before, after = (encode_stripes(each, 2, Tables.frozen(2)).stripes for each in (steps, other))
    assert [number for number in range(len(before)) if before[number] != after[number]] == [1]


def test_a_map_with_tables_of_its_own_is_never_larger_and_a_small_one_has_none() -> None:
    steps = slanted_scene(640, 720)
    for bound in BOUNDS:
        assert encode_stripes(steps, bound).size < encode_stripes(steps, bound, Tables.frozen(bound)).size
        assert encode_stripes(steps[:4, 40:60], bound).tables == b""


def test_a_view_that_is_not_contiguous_is_the_same_map() -> None:
    steps = slanted_scene()[::2, ::-1]
    assert encode_stripes(steps, 1) == encode_stripes(np.ascontiguousarray(steps), 1)


def test_a_noisy_scene_takes_less_than_codec_1_and_a_third_of_it_at_an_eighth_of_a_pixel() -> None:
    steps = slanted_scene(640, 720)
    baseline = sum(map(len, codec.encode(steps)))
    exact, eighth = (encode_stripes(steps, bound).size / baseline for bound in (0, 2))
    assert exact < 0.85
    assert eighth < 1 / 3


@pytest.mark.parametrize("width", [1, 640, 2000, 2001, 2048])
def test_even_noise_grows_by_four_bytes_only_and_fits_a_stripe(width: int) -> None:
    rows = codec.rows_per_stripe(width)
    noise = np.random.default_rng(0).integers(1, 65536, (rows, width), dtype=np.uint16)
    encoded = encode_stripes(noise, 0)
    assert len(encoded.stripes[0]) <= 4 + noise.nbytes <= LIMITS.stripe
    np.testing.assert_array_equal(decoded(encoded, noise.shape, 0), noise)


@pytest.mark.parametrize("bound", [-1, 3, 5, 16])
def test_another_bound_is_refused(bound: int) -> None:
    with pytest.raises(UsageError, match=f"a bound of {bound} sixteenths"):
        encode_stripes(slanted_scene(), bound)


@pytest.mark.parametrize("shape", [(0, 5), (5, 0), (2049, 4), (4, 2049), (4,), (2, 2, 2)])
def test_a_map_of_an_impossible_size_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(WireError, match="1 to 2048"):
        encode_stripes(np.zeros(shape, np.uint16), 0)


@pytest.mark.parametrize(("rows", "width"), [(0, 5), (5, 0), (-1, 5), (17, 2048)])
def test_a_stripe_of_an_impossible_size_is_refused(rows: int, width: int) -> None:
    with pytest.raises(WireError, match="pixels are allowed"):
        decode_stripe(bytes(8), rows, width, 0, Tables.frozen(0))


def test_a_stripe_read_with_another_bound_or_other_tables_is_refused() -> None:
    encoded = encode_stripes(slanted_scene()[:16], 2)
    own = Tables.read(encoded.tables, 2)
    for rows, width, bound, tables in (
        (16, 160, 1, own),
        (16, 160, 2, Tables.frozen(2)),
        (15, 160, 2, own),
        (32, 80, 2, own),
    ):
        with pytest.raises(WireError):
            decode_stripe(encoded.stripes[0], rows, width, bound, tables)


def wrongly_accepted(count: int, seed: int) -> int:
    """Damage stripes in `count` ways (bits, bytes, cuts, repeats, noise); count those that pass with other pixels."""
    random, wrong = np.random.default_rng(seed), 0
    scene = slanted_scene()
    cases = [(bound, encode_stripes(scene[top : top + 16], bound)) for bound in BOUNDS for top in (0, 64, 128)]
    cases.append((0, encode_stripes(random.integers(1, 65536, (16, 160), dtype=np.uint16), 0)))
    truths = [decoded(encoded, (16, 160), bound) for bound, encoded in cases]
    tables = [Tables.read(encoded.tables, bound) for bound, encoded in cases]
    for _ in range(count):
        case = int(random.integers(len(cases)))
        bound, encoded = cases[case]
        try:
            restored = decode_stripe(damaged(encoded.stripes[0], random), 16, 160, bound, tables[case])
        except WireError:
            continue
        wrong += not np.array_equal(restored, truths[case])
    return wrong


def damaged(stripe: bytes, random: np.random.Generator) -> bytes:
    data, kind = bytearray(stripe), random.integers(6)
    at = int(random.integers(len(data)))
    if kind <= 1:  # the end of a stripe is where one symbol's error is least likely to spread
        at = at if kind else len(data) - 1 - int(random.integers(min(8, len(data))))
        data[at] ^= 1 << random.integers(8)
    elif kind == 2:
        for place in random.integers(len(data), size=random.integers(1, 5)):
            data[place] ^= random.integers(1, 256)
    elif kind == 3:
        del data[at & ~1 :]
    elif kind == 4:
        data[at:at] = data[at : at + 2 * int(random.integers(1, 9))]
    else:
        data = bytearray(random.bytes(2 * int(random.integers(1, 400))))
    return bytes(data)


def test_of_two_thousand_damaged_stripes_none_passes_with_a_wrong_pixel() -> None:
    assert wrongly_accepted(2000, seed=12) == 0


@pytest.mark.soak
def test_of_a_hundred_thousand_damaged_stripes_none_passes_with_a_wrong_pixel() -> None:
    wrong = wrongly_accepted(100_000, seed=13)
    print(f"codec 2: 100,000 damaged stripes, {wrong} passed with wrong pixels")
    assert wrong == 0


@settings(deadline=None)
@given(st.binary(max_size=300), st.integers(1, 40), st.integers(1, 40), st.sampled_from(BOUNDS))
def test_arbitrary_bytes_raise_nothing_but_a_wire_error(data: bytes, rows: int, width: int, bound: int) -> None:
    with contextlib.suppress(WireError):
        assert decode_stripe(data, rows, width, bound, Tables.frozen(bound)).shape == (rows, width)
    with contextlib.suppress(WireError):
        assert Tables.read(data, bound).entries.shape == (28 * 64,)


def test_the_largest_stripe_of_nonsense_is_refused_within_five_milliseconds() -> None:
    random, times = np.random.default_rng(1), []
    for _ in range(9):
        data = random.bytes(20_000)
        begin = time.thread_time()
        with pytest.raises(WireError):
            decode_stripe(data, 16, 2000, 0, Tables.frozen(0))
        times.append(time.thread_time() - begin)
    assert np.median(times) < 0.005


HOSTILE = """
import sys
sys.path.insert(0, sys.argv[1])
from numba.core import config
from device.test_codec_compact import *
assert config.BOUNDSCHECK == 1
for steps, bound in small_maps(400):
    assert_faithful(steps, bound)
assert wrongly_accepted(20_000, seed=14) == 0
"""


@pytest.mark.soak
def test_no_bytes_make_the_kernels_leave_their_arrays(tmp_path: Path) -> None:
    checked = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    tests = str(Path(__file__).parents[1])
    subprocess.run([sys.executable, "-c", HOSTILE, tests], check=True, env=os.environ | checked, timeout=600)
