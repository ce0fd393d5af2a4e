from __future__ import annotations

import numpy as np
import pytest
from cobs import cobs
from hypothesis import example, given, settings
from hypothesis import strategies as st

from prismstereo_device import kernels

# Long runs without a zero are what the 254-byte pieces are about; plain random bytes seldom have them.
RUNS = st.lists(st.tuples(st.integers(0, 600), st.binary(max_size=3)), max_size=4)
PACKETS = RUNS.map(lambda runs: b"".join(b"\x07" * length + rest for length, rest in runs))


def stuffed(raw: bytes) -> bytes:
    out = np.empty(len(raw) + len(raw) // 254 + 1, np.uint8)
    return out[: kernels.cobs_encode(np.frombuffer(raw, np.uint8), out)].tobytes()


def restored(encoded: bytes) -> bytes | None:
    out = np.empty(len(encoded), np.uint8)
    length = kernels.cobs_decode(np.frombuffer(encoded, np.uint8), out)
    return None if length < 0 else out[:length].tobytes()


def by_the_oracle(encoded: bytes) -> bytes | None:
    try:
        return bytes(cobs.decode(encoded))
    except cobs.DecodeError:
        return None


@settings(deadline=None)
@given(PACKETS)
@example(b"")
@example(b"\x00")
@example(b"\x01" * 254)
@example(b"\x01" * 254 + b"\x00")
@example(b"\x01" * 255)
@example(b"\x01" * 508)
def test_a_packet_is_stuffed_as_the_cobs_package_does_and_comes_back(raw: bytes) -> None:
    encoded = stuffed(raw)
    assert encoded == cobs.encode(raw)
    assert 0 not in encoded
    assert restored(encoded) == raw


@settings(deadline=None)
@given(st.binary(max_size=40) | st.lists(st.sampled_from([0, 1, 2, 3, 254, 255]), max_size=300).map(bytes))
def test_any_bytes_are_decoded_or_refused_as_the_cobs_package_does(encoded: bytes) -> None:
    assert restored(encoded) == by_the_oracle(encoded)


@settings(deadline=None, max_examples=40)
@given(PACKETS)
def test_the_compiled_kernels_do_what_their_source_says(raw: bytes) -> None:
    source = np.frombuffer(raw, np.uint8)
    out = np.empty(source.size + source.size // 254 + 1, np.uint8)
    length = kernels.cobs_encode.py_func(source, out)
    assert out[:length].tobytes() == stuffed(raw)
    back = np.empty(length, np.uint8)
    assert kernels.cobs_decode.py_func(out[:length], back) == source.size
    assert back[: source.size].tobytes() == raw


@pytest.mark.parametrize("kernel", [kernels.cobs_encode, kernels.cobs_decode])
def test_a_buffer_that_is_too_small_is_refused_and_left_alone(kernel) -> None:
    buffer = np.full(8, 9, np.uint8)
    assert kernel(np.ones(9, np.uint8), buffer) == -1
    np.testing.assert_array_equal(buffer, 9)
