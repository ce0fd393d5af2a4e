"""The long campaigns behind the figures of the link: a row is printed for each."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
import time
from dataclasses import replace

import pytest

from host.faulty_line import BAUD, eventually, watched
from prismstereo.link_bench.bench_case import BenchCase, standard_cases
from prismstereo.link_bench.bench_result import BenchResult
from prismstereo.link_bench.run import run_case

CASES = standard_cases(BenchCase("any"))
FULL_LINES = [
    (921_600, 320, 360, 2, 9.0),
    (921_600, 320, 360, 4, 10.0),
    (3_000_000, 640, 720, 4, 7.0),
    (9_800_000, 640, 720, None, 25.0),
]
HOST = """
import sys
from prismstereo.driver import StereoCamera
with StereoCamera.open(sys.argv[1], 10.0, baud=3_000_000) as camera:
    for frame in camera:
        print(frame.index, flush=True)
"""

pytestmark = pytest.mark.soak


def shown(case: BenchCase, result: BenchResult) -> dict[str, float]:
    figures = {key: value for key, value in result.figures().items() if isinstance(value, int | float)}
    print(f"\n{case.name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figures.items()))
    assert result.wrong_stripes == 0
    assert result.run_twice == 0
    assert not result.transfer_wrong
    return figures


@pytest.mark.parametrize("case", [case for case in CASES if not case.faults and not case.reboot], ids=lambda c: c.name)
def test_a_full_clean_line_is_quick_to_answer_and_young(case: BenchCase) -> None:
    figures = shown(case, run_case(replace(case, seconds=20.0)))
    assert figures["stripes_ok_percent"] == pytest.approx(100.0, abs=5.0)  # but for the frames under way
    assert figures["command_p99_ms"] < (200 if case.baud == 115_200 else 50)
    assert figures["age_p50_ms"] <= 2 * 1000 / figures["frames_per_s"]
    assert figures["commands_unknown"] == figures["commands_failed"] == 0


@pytest.mark.parametrize("case", [case for case in CASES if case.faults], ids=lambda case: case.name)
def test_no_fault_makes_wrong_right(case: BenchCase) -> None:
    figures = shown(case, run_case(replace(case, seconds=15.0)))
    if case.faults == "flips=1e-4":
        assert figures["stripes_ok_percent"] >= 85
    if case.faults.startswith("cut"):
        assert figures["recovery_s"] < 1.0
    if case.faults.startswith("baud"):
        assert figures["recovery_s"] < 0.5
    if case.faults.startswith("replug"):
        assert figures["recovery_s"] < 3.0
    if case.faults.startswith("stall"):
        stall_ms = 1000 * float(case.faults.removeprefix("stall=").partition("/")[0])
        assert figures["age_max_ms"] <= 3 * 1000 / 8 + stall_ms  # a line that is full has 8 to 10 frames a second


@pytest.mark.parametrize(("baud", "width", "height", "bound", "frames_per_s"), FULL_LINES)
def test_a_line_carries_the_frames_that_are_promised(
    baud: int, width: int, height: int, bound: int | None, frames_per_s: float
) -> None:
    case = BenchCase(
        f"{width}x{height} at {baud}, bound {bound}", "", baud, 20.0, width, height, rate_hz=30.0, bound=bound
    )
    figures = shown(case, run_case(case))
    assert figures["frames_per_s"] >= frames_per_s
    assert figures["age_p50_ms"] <= 2 * 1000 / figures["frames_per_s"]


def test_a_far_end_that_is_killed_and_started_again_is_found() -> None:
    case = next(case for case in CASES if case.reboot)
    figures = shown(case, run_case(replace(case, seconds=12.0)))
    assert figures["recovery_s"] < 3.0
    assert figures["sessions"] >= 2


def test_a_hundred_replugs_are_a_hundred_recoveries_and_nothing_is_left() -> None:
    with watched() as watch:
        before = len(os.listdir("/dev/fd")), threading.active_count()
        longest_s = 0.0
        for number in range(1, 101):
            watch.line.replug(random.Random(number).choice((0.0, 0.02, 0.3)))
            back_s = time.monotonic()
            assert eventually(lambda number=number: watch.camera.statistics.replugs == number)
            longest_s = max(longest_s, watch.frames_from(back_s, 1)[0].at_s - back_s)
        assert (len(os.listdir("/dev/fd")), threading.active_count()) == before
        assert watch.wrong == 0
    print(f"\n100 replugs: 100 recoveries, the longest took {longest_s:.2f} s")
    assert longest_s < 3.0


def test_a_host_that_is_killed_makes_room_for_the_next() -> None:
    with watched() as watch:
        watch.camera.close()
        longest_s = 0.0
        for _ in range(10):
            begun_s = time.monotonic()
            with subprocess.Popen(
                [sys.executable, "-c", HOST, watch.line.host_port], stdout=subprocess.PIPE, text=True
            ) as host:
                assert host.stdout is not None
                numbers = [int(host.stdout.readline()) for _ in range(3)]
                longest_s = max(longest_s, time.monotonic() - begun_s)
                host.kill()
            assert numbers == sorted(numbers)
        assert watch.service.statistics.sessions == 11
    print(f"\n10 hosts killed: the next one had 3 frames after {longest_s:.2f} s, its start included")


def test_a_megabyte_that_is_cut_ten_times_arrives_whole() -> None:
    content = random.Random(6).randbytes(500_000).hex()
    with watched("chunkdrop=0.02", rate_hz=5.0) as watch:
        sending = threading.Thread(target=watch.camera.send_update, args=(content.encode(),))
        sending.start()
        for cut in range(1, 11):
            wanted = random.Random(cut).randrange(80_000, 99_000) * cut
            assert eventually(lambda wanted=wanted: watch.objects.held_bytes > wanted, 60.0)
            watch.line.replug()
        sending.join(120.0)
        assert not sending.is_alive()
        assert watch.camera.log() == content
        assert watch.objects.commits == 1
        print(
            f"\n1 MB up and down with 10 cuts: {watch.camera.statistics.repeated} requests repeated, line {BAUD} baud"
        )
