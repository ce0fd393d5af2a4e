from __future__ import annotations

import itertools

import numpy as np
import pytest

from prismstereo.clock import ClockFit, Probe

START_US = (1 << 32) - 30_000_000  # half a minute below the wrap of a 32-bit counter


class TwoClocks:
    """A host and a device whose clock runs `skew_ppm` fast, with a line that delays each way as it likes."""

    def __init__(self, seed: int, skew_ppm: float, ahead_us: float = 123_456_789.0) -> None:
        self.random = np.random.default_rng(seed)
        self.skew = skew_ppm * 1e-6
        self.ahead_us = ahead_us

    def device_us(self, host_us: float) -> int:
        return int(START_US + self.ahead_us + (host_us - START_US) * (1 + self.skew))

    def probe(self, host_us: float, there_us: float, back_us: float) -> Probe:
        arrives = host_us + there_us
        leaves = arrives + 20
        return Probe(int(host_us), self.device_us(arrives), self.device_us(leaves), int(leaves + back_us))

    def serial(self, host_us: float, packet_us: float, busy: float, least_us: float) -> Probe:
        """A probe over a serial line: some packets of video may be before the answer, and the host may be late."""
        whole_us = self.random.integers(0, 3) * packet_us * (self.random.random() < busy)
        waiting_us = whole_us + self.random.random() * packet_us * busy
        late_us = self.random.exponential(150.0)
        return self.probe(host_us, least_us + self.random.exponential(100.0), 1.4 * least_us + waiting_us + late_us)


def off_us(fit: ClockFit, clocks: TwoClocks, host_us: float) -> float:
    assert fit.mapping is not None
    return fit.mapping.host_time_us(clocks.device_us(host_us)) - host_us


@pytest.mark.parametrize(
    ("packet_us", "least_us", "most_us"), [(5600, 450, 1000), (21_000, 3600, 5000)], ids=["921600 baud", "115200 baud"]
)
@pytest.mark.parametrize("skew_ppm", [30.0])
def test_an_hour_of_a_busy_serial_line_keeps_the_offset_within_its_bound(
    skew_ppm: float, packet_us: float, least_us: float, most_us: float
) -> None:
    clocks, fit = TwoClocks(3, skew_ppm), ClockFit()
    errors_us, bounds_us = np.zeros(3600), np.zeros(3600)
    for second in range(3600):
        host_us = START_US + second * 1e6
        fit.add(clocks.serial(host_us, packet_us, 0.9, least_us))
        assert fit.mapping is not None
        errors_us[second] = abs(off_us(fit, clocks, host_us + 900_000))
        bounds_us[second] = fit.mapping.bound_us
    assert fit.resets == 0
    assert np.max(errors_us - bounds_us) < 1.0
    assert errors_us[60:].max() < most_us
    assert np.median(errors_us) < most_us / 3
    assert abs(fit.mapping.skew_ppm + skew_ppm) < 10


def test_a_quiet_line_gives_tens_of_microseconds() -> None:
    clocks, fit = TwoClocks(5, 75.0), ClockFit()
    for second in range(120):
        fit.add(clocks.serial(START_US + second * 1e6, 0.0, 0.0, 100))
    assert abs(off_us(fit, clocks, START_US + 119.5e6)) < 120
    assert fit.mapping is not None
    assert fit.mapping.bound_us < 300
    assert abs(fit.mapping.skew_ppm + 75.0) < 5


def test_the_first_probe_gives_a_mapping_and_its_bound_is_half_its_round_trip() -> None:
    clocks, fit = TwoClocks(1, 0.0), ClockFit()
    assert fit.mapping is None
    fit.add(clocks.probe(START_US, 700, 300))
    assert fit.mapping is not None
    assert fit.mapping.bound_us == pytest.approx(500, abs=2)
    assert abs(off_us(fit, clocks, START_US)) == pytest.approx(200, abs=2)


def test_a_device_clock_that_steps_back_is_followed_at_once() -> None:
    clocks, fit = TwoClocks(1, 0.0), ClockFit()
    for second in range(20):
        fit.add(clocks.probe(START_US + second * 1e6, 500, 500))
    clocks.ahead_us -= 60e6
    fit.add(clocks.probe(START_US + 20e6, 500, 500))
    assert fit.resets == 1
    assert abs(off_us(fit, clocks, START_US + 20e6)) < 10


def test_a_single_wild_probe_changes_nothing_and_five_in_a_row_are_believed() -> None:
    clocks, fit = TwoClocks(1, 10.0), ClockFit()
    for second in range(20):
        fit.add(clocks.probe(START_US + second * 1e6, 500, 500))
    before = fit.mapping
    clocks.ahead_us += 3_600e6
    fit.add(clocks.probe(START_US + 20e6, 500, 500))
    assert fit.mapping is before
    for second in range(21, 25):
        fit.add(clocks.probe(START_US + second * 1e6, 500, 500))
    assert fit.resets == 1
    assert abs(off_us(fit, clocks, START_US + 24e6)) < 10


def test_a_long_queue_is_no_outlier() -> None:
    clocks, fit = TwoClocks(1, 0.0), ClockFit()
    for second in range(20):
        fit.add(clocks.probe(START_US + second * 1e6, 500, 500))
    for second in range(20, 26):
        fit.add(clocks.probe(START_US + second * 1e6, 500, 900_000))
    assert fit.resets == 0
    assert abs(off_us(fit, clocks, START_US + 25e6)) < 10


def test_stamps_that_cannot_be_are_ignored() -> None:
    fit = ClockFit()
    fit.add(Probe(1000, 5000, 4000, 2000))
    fit.add(Probe(1000, 5000, 9000, 2000))
    assert fit.mapping is None


def test_a_new_boot_forgets_the_old_clock() -> None:
    clocks, fit = TwoClocks(1, 0.0), ClockFit()
    fit.add(clocks.probe(START_US, 500, 500))
    fit.reset()
    assert fit.mapping is None
    clocks.ahead_us = -float(START_US)
    fit.add(clocks.probe(START_US + 1e6, 500, 500))
    assert fit.resets == 0
    assert abs(off_us(fit, clocks, START_US + 1e6)) < 10


@pytest.mark.soak
def test_hours_of_busy_and_quiet_lines() -> None:
    print("\nline           skew ppm  error us: median  longest after 60 s  beyond its bound  bound us: median")
    lines = {"921600 busy": (5600, 0.9, 450), "115200 busy": (21_000, 0.9, 3600), "USB quiet": (0, 0.0, 100)}
    for (name, (packet_us, busy, least_us)), skew_ppm in itertools.product(lines.items(), (-100, -30, 0, 30, 100)):
        clocks, fit = TwoClocks(skew_ppm + 200, skew_ppm), ClockFit()
        errors_us, bounds_us = np.zeros(3600), np.zeros(3600)
        for second in range(3600):
            host_us = START_US + second * 1e6
            fit.add(clocks.serial(host_us, packet_us, busy, least_us))
            errors_us[second] = abs(off_us(fit, clocks, host_us + 900_000))
            assert fit.mapping is not None
            bounds_us[second] = fit.mapping.bound_us
        beyond = int(np.count_nonzero(errors_us > bounds_us + 200))  # 200 ppm for the 0.9 s since the probe
        most_us = errors_us[60:].max()
        figures = np.median(errors_us), most_us, beyond, np.median(bounds_us)
        print(f"{name:12s}  {skew_ppm:8d}", *(f"{figure:18.0f}" for figure in figures))
        assert beyond == 0
        assert most_us < (5000 if packet_us > 10_000 else 1000)
