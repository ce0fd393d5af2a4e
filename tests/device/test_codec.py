from __future__ import annotations

import contextlib
import time
import tracemalloc

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from prismstereo_device import codec
from prismstereo_device.wire import LIMITS, WireError

ANY_STEP = st.sampled_from([0, 0, 1, 2, 255, 256, 32767, 32768, 65534, 65535]) | st.integers(0, 65535)


def slanted_scene(height: int = 180, width: int = 160, seed: int = 3) -> NDArray[np.uint16]:
    """Slanted planes with steps between them, sub-pixel noise, holes and an unmatched border."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width]
    steps = 300 + rows * 1.5 + columns * 0.4 + 400 * (columns > width // 2) + random.normal(0, 1.2, rows.shape)
    holes = (random.random((height // 8 + 1, width // 8 + 1)) < 0.15).repeat(8, 0).repeat(8, 1)[:height, :width]
    return np.where(holes | (columns < 12), 0, np.rint(steps)).astype(np.uint16)


def decoded(stripes: list[bytes], height: int, width: int) -> NDArray[np.uint16]:
    rows = codec.rows_per_stripe(width)
    parts = [codec.decode_stripe(data, min(rows, height - top * rows), width) for top, data in enumerate(stripes)]
    return np.concatenate(parts)


def packed(plain: bytes, *, check: bool = True, size: bool = True) -> bytes:
    return zstandard.ZstdCompressor(write_checksum=check, write_content_size=size).compress(plain)


MAPS = {
    "a slanted scene": slanted_scene(),
    "one pixel": np.array([[77]], np.uint16),
    "one unmatched pixel": np.zeros((1, 1), np.uint16),
    "all unmatched": np.zeros((50, 33), np.uint16),
    "constant": np.full((40, 21), 1234, np.uint16),
    "the largest value": np.full((17, 5), 65535, np.uint16),
    "a checkerboard of the extremes": (np.indices((48, 31)).sum(0) % 2 * 65534 + 1).astype(np.uint16),
    "a checkerboard of holes": (np.indices((48, 31)).sum(0) % 2 * 900).astype(np.uint16),
    "one column": slanted_scene()[:, 40:41],
    "one row": slanted_scene()[70:71],
    "the widest row": np.arange(2048, dtype=np.uint16)[None],
}


@pytest.mark.parametrize("steps", MAPS.values(), ids=MAPS.keys())
def test_a_map_comes_back_exactly(steps: NDArray[np.uint16]) -> None:
    stripes = codec.encode(steps)
    np.testing.assert_array_equal(decoded(stripes, *steps.shape), steps)


@settings(deadline=None)
@given(hnp.arrays(np.uint16, hnp.array_shapes(min_dims=2, max_dims=2, max_side=40), elements=ANY_STEP))
def test_any_map_comes_back_exactly(steps: NDArray[np.uint16]) -> None:
    np.testing.assert_array_equal(decoded(codec.encode(steps), *steps.shape), steps)


def test_a_view_that_is_not_contiguous_is_the_same_map() -> None:
    steps = slanted_scene()
    assert codec.encode(steps[::2, ::-1]) == codec.encode(np.ascontiguousarray(steps[::2, ::-1]))


def test_a_scene_takes_less_than_zstd_alone_needs() -> None:
    steps = slanted_scene(640, 720)
    ours = sum(map(len, codec.encode(steps)))
    assert ours < 0.75 * len(packed(steps.tobytes()))


def test_stripes_do_not_depend_on_one_another() -> None:
    steps = slanted_scene()
    other = steps.copy()
    other[16:32] = 0
    before, after = codec.encode(steps), codec.encode(other)
    assert [number for number in range(len(before)) if before[number] != after[number]] == [1]


@pytest.mark.parametrize("width", [1, 640, 2000, 2001, 2048])
def test_even_noise_fits_a_stripe(width: int) -> None:
    rows = codec.rows_per_stripe(width)
    noise = np.random.default_rng(0).integers(0, 65536, (rows, width), dtype=np.uint16)
    (stripe,) = codec.encode(noise)
    assert 15 <= rows <= 16
    assert len(stripe) <= LIMITS.stripe
    np.testing.assert_array_equal(codec.decode_stripe(stripe, rows, width), noise)


@pytest.mark.parametrize("shape", [(0, 5), (5, 0), (2049, 4), (4, 2049), (4,), (2, 2, 2)])
def test_a_map_of_an_impossible_size_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(WireError, match="1 to 2048"):
        codec.encode(np.zeros(shape, np.uint16))


def test_damaged_stripes_are_refused_and_never_break_the_reader() -> None:
    random = np.random.default_rng(11)
    stripe = codec.encode(slanted_scene(16, 160))[0]
    wrong = 0
    for _ in range(5000):
        damaged = bytearray(stripe)
        for _ in range(random.integers(1, 4)):
            damaged[random.integers(len(damaged))] ^= random.integers(1, 256)
        cut = bytes(damaged[: random.integers(len(damaged)) if random.random() < 0.2 else None])
        try:
            assert codec.decode_stripe(cut, 16, 160).shape == (16, 160)
            wrong += cut != stripe
        except WireError:
            pass
    assert wrong == 0


@settings(deadline=None)
@given(st.binary(max_size=200) | st.binary(max_size=60).map(packed), st.integers(-1, 3000), st.integers(-1, 3000))
def test_arbitrary_bytes_raise_nothing_but_a_wire_error(data: bytes, rows: int, width: int) -> None:
    with contextlib.suppress(WireError):
        assert codec.decode_stripe(data, rows, width).shape == (rows, width)


@settings(deadline=None)
@given(st.binary(min_size=48, max_size=48))
def test_any_symbols_make_a_map(planes: bytes) -> None:
    assert codec.decode_stripe(packed(planes), 4, 6).shape == (4, 6)


def test_a_bomb_is_refused_before_it_unfolds() -> None:
    bomb = packed(bytes(100_000_000))
    assert len(bomb) < 20_000
    tracemalloc.start()
    begin = time.thread_time()
    try:
        with pytest.raises(WireError, match="100000000 bytes: 20480 are due"):
            codec.decode_stripe(bomb, 16, 640)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert time.thread_time() - begin < 0.05
    assert peak < 1 << 20


@pytest.mark.parametrize(
    "data",
    [
        packed(bytes(20480), size=False),
        packed(bytes(20480), check=False),
        packed(bytes(20479)),
        packed(bytes(20480)) + b"more",
        packed(bytes(20480))[:-1],
        b"",
    ],
    ids=["no size", "no check sum", "too little", "something after it", "cut", "nothing"],
)
def test_only_a_checked_frame_of_the_exact_size_is_unpacked(data: bytes) -> None:
    with pytest.raises(WireError):
        codec.decode_stripe(data, 16, 640)
