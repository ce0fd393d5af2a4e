from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from device.service_host import smooth
from prismstereo_device.serving.rate_control import EXACT, LADDER, Mode, RateControl, halved
from prismstereo_hw.errors import UsageError

BPS = {"115200": 11_174, "921600": 89_395, "3 M": 291_000, "USB full speed": 1_000_000, "USB high speed": 30_000_000}
SHARES = dict(zip(LADDER, (1.0, 0.58, 0.43, 0.31, 0.075), strict=True))  # of other scenes than the known ones
BITS = 1.45


@dataclass
class Line:
    """A simulated line: frames of a source at `source_hz`, the newest wins, a buffer that takes `buffer_bytes` at once."""

    bytes_per_s: float
    pixels: int
    source_hz: float = 25.0
    buffer_bytes: int = 0
    seed: int = 1
    now_s: float = 0.0
    sent: list[tuple[float, Mode]] = field(default_factory=list)
    _free_s: float = 0.0

    def run(self, control: RateControl, until_s: float) -> None:
        rng = np.random.default_rng(self.seed)
        while self.now_s < until_s:
            mode = control.mode_for(self.pixels)
            size = int(self.pixels * BITS / 8 * SHARES[mode] * rng.normal(1.0, 0.04))
            self._free_s = max(self._free_s, self.now_s) + size / self.bytes_per_s
            line_s = max(0.0, self._free_s - self.buffer_bytes / self.bytes_per_s - self.now_s)
            began_s, self.now_s = self.now_s, self.now_s + line_s
            control.sent(mode, size, line_s, self.now_s, source_s=1 / self.source_hz * rng.normal(1.0, 0.02))
            self.sent.append((self.now_s, mode))
            self.now_s = max(self.now_s, (np.floor(began_s * self.source_hz) + 1) / self.source_hz)

    def modes(self, from_s: float) -> list[Mode]:
        return [mode for at_s, mode in self.sent if at_s >= from_s]

    def changes(self, from_s: float) -> int:
        modes = self.modes(from_s)
        return sum(a != b for a, b in pairwise(modes))

    def rate_hz(self, from_s: float) -> float:
        return len(self.modes(from_s)) / (self.now_s - from_s)


VGA, QUARTER = 640 * 720, 320 * 360


@pytest.mark.parametrize(
    ("line", "pixels", "source_hz", "due"),
    [
        ("115200", VGA, 10.0, Mode(4, halved=True)),
        ("115200", QUARTER, 10.0, Mode(4, halved=True)),
        ("921600", VGA, 10.0, Mode(4, halved=True)),
        ("921600", QUARTER, 9.0, Mode(2)),
        ("3 M", VGA, 7.0, Mode(2)),
        ("3 M", VGA, 25.0, Mode(4, halved=True)),
        ("USB full speed", VGA, 25.0, Mode(2)),
        ("USB full speed", QUARTER, 25.0, EXACT),
        ("USB high speed", VGA, 30.0, EXACT),
    ],
)
def test_the_finest_mode_that_the_line_carries_is_found_in_three_seconds_and_kept(
    line: str, pixels: int, source_hz: float, due: Mode
) -> None:
    control = RateControl(line_bytes_per_s=BPS[line] if line == "115200" else None)
    simulated = Line(BPS[line], pixels, source_hz)
    simulated.run(control, 60.0)
    assert set(simulated.modes(3.0)) == {due}
    assert simulated.rate_hz(3.0) > 0.93 * min(source_hz, BPS[line] / (pixels * BITS / 8 * SHARES[due]))


@pytest.mark.parametrize("buffer_bytes", [4096, 65_536])
@pytest.mark.parametrize("line", BPS)
def test_a_buffer_that_swallows_small_frames_makes_it_flap_ever_more_rarely(line: str, buffer_bytes: int) -> None:
    control = RateControl(line_bytes_per_s=BPS[line] if line == "115200" else None)
    simulated = Line(BPS[line], VGA, buffer_bytes=buffer_bytes)
    simulated.run(control, 120.0)
    assert simulated.changes(60.0) <= 4


def test_a_wish_of_fewer_frames_buys_finer_ones() -> None:
    control = RateControl(target_hz=3.0)
    simulated = Line(BPS["USB full speed"], VGA)
    simulated.run(control, 20.0)
    assert set(simulated.modes(3.0)) == {EXACT}


def test_a_line_that_gets_slow_is_noticed_at_once_and_one_that_recovers_is_used_again() -> None:
    control = RateControl()
    simulated = Line(BPS["USB full speed"], VGA)
    simulated.run(control, 20.0)
    simulated.bytes_per_s = 250_000
    simulated.run(control, 30.0)
    assert set(simulated.modes(23.0)) == {Mode(4, halved=True)}
    simulated.bytes_per_s = BPS["USB full speed"]
    simulated.run(control, 60.0)
    assert set(simulated.modes(45.0)) == {Mode(4)}
    assert simulated.changes(20.0) <= 6


def test_a_fifth_of_the_frames_is_lost_before_the_resolution_is_halved() -> None:
    control = RateControl()
    simulated = Line(BPS["3 M"], VGA, source_hz=13.0)  # carries 11.2 frames/s at 1/4 px
    simulated.run(control, 20.0)
    assert set(simulated.modes(3.0)) == {Mode(4)}
    assert simulated.rate_hz(3.0) > 0.8 * 13


def test_the_time_of_coding_is_counted_and_not_taken_for_the_lines() -> None:
    control = RateControl()
    for number in range(100):  # sending takes 0.5 of the time, coding 0.3 more: the next finer would take 1.0
        control.sent(control.mode, 10_000, 0.5 * 0.04, number * 0.04, source_s=0.04, coding_s=0.3 * 0.04)
    assert control.mode == EXACT
    for number in range(100, 200):
        control.sent(control.mode, 10_000, 0.8 * 0.04, number * 0.04, source_s=0.04, coding_s=0.3 * 0.04)
        if control.mode != EXACT:
            break
    assert control.mode == Mode(1)  # 0.8 * 0.55 + 0.3 of the time


def test_a_single_hiccup_changes_nothing() -> None:
    control = RateControl()
    simulated = Line(BPS["USB full speed"], VGA)
    simulated.run(control, 10.0)
    control.sent(control.mode, 40_000, 0.5, simulated.now_s + 0.5)
    simulated.run(control, 20.0)
    assert set(simulated.modes(5.0)) == {Mode(2)}


def test_a_known_line_is_right_from_the_first_frame_on() -> None:
    control = RateControl(target_hz=9.0, line_bytes_per_s=BPS["921600"])
    assert control.mode_for(QUARTER) == Mode(2)
    assert RateControl(target_hz=10.0).mode_for(QUARTER) == EXACT


@pytest.mark.parametrize("bound", [0, 1, 2, 4])
def test_a_bound_that_is_chosen_holds_whatever_the_line_does(bound: int) -> None:
    control = RateControl()
    control.choose(bound)
    simulated = Line(BPS["921600"], VGA)
    simulated.run(control, 10.0)
    assert set(simulated.modes(0.0)) == {Mode(bound)}
    control.choose(None)
    simulated.run(control, 20.0)
    assert set(simulated.modes(13.0)) == {Mode(4, halved=True)}


@pytest.mark.parametrize(
    ("ask", "told"),
    [
        (lambda: RateControl(bound=3), "a bound of 3 sixteenths: it is one of"),
        (lambda: RateControl(target_hz=0.0), "a target of 0 frames a second"),
        (lambda: RateControl().choose(-1), "a bound of -1"),
    ],
)
def test_what_cannot_be_is_refused(ask: Callable[[], object], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        ask()


def test_a_halved_map_has_half_the_sides_and_the_same_depths() -> None:
    large = smooth(3, 96, 128)
    small = halved(large)
    assert small.disparity_px.shape == (48, 64)
    nearest = np.nan_to_num(large.depth(), nan=np.inf).reshape(48, 2, 64, 2).min(axis=(1, 3))
    np.testing.assert_allclose(np.nan_to_num(small.depth(), nan=np.inf), nearest, rtol=1e-5)
    assert small.reasons is None
