from __future__ import annotations

import json

import pytest

from host.command import in_process
from prismstereo.cli.bench import link
from prismstereo.link_bench.bench_case import BenchCase, standard_cases
from prismstereo.link_bench.bench_result import Arrival, BenchResult, recovery_s
from prismstereo.link_bench.judging import Judgement
from prismstereo_hw.errors import UsageError


def arrival(at_s: float, *, wrong: int = 0, partial: bool = False) -> Arrival:
    return Arrival(at_s, 0.1, partial, Judgement(10, 10 - wrong - partial, wrong))


def result(*arrivals: Arrival, run_twice: int = 0, transfer_wrong: bool = False) -> BenchResult:
    return BenchResult(
        arrivals=arrivals,
        seconds=2.0,
        sent_frames=4,
        command_s=(0.001, 0.003, 0.002),
        commands_unknown=0,
        commands_failed=0,
        run_twice=run_twice,
        recovery_s=None,
        upload_s=None,
        download_s=None,
        transfer_bytes=0,
        transfer_wrong=transfer_wrong,
        sessions=1,
        far_end_cpu_percent=0.0,
    )


def test_a_line_with_faults_is_measured_and_nothing_wrong_is_taken_for_right() -> None:
    wish = [
        "--faults",
        "flips=1e-5",
        "--seconds",
        "1",
        "--size",
        "160x96",
        "--rate",
        "20",
        "--line",
        "9800000",
        "--json",
    ]
    code, said = in_process(link, *wish)
    (case,) = json.loads(said)["cases"]
    assert code == 0
    assert (case["passed"], case["wrong_stripes"], case["commands_run_twice"]) == (True, 0, 0)
    assert (case["baud"], case["faults"], case["sessions"]) == (9_800_000, "flips=1e-5", 1)
    assert case["whole_frames"] + case["partial_frames"] >= 3
    assert case["stripes_ok_percent"] > 70
    assert 0 < case["command_p50_ms"] < 1000
    assert case["download_s"] is not None


@pytest.mark.parametrize(
    ("wish", "complaint"),
    [("--faults flops=1", "kinds are flips"), ("--line 10", "10 baud"), ("--size 640", "WIDTHxHEIGHT")],
)
def test_a_wish_that_cannot_be_run_is_refused_before_anything_starts(wish: str, complaint: str) -> None:
    import click

    with pytest.raises((UsageError, click.UsageError), match=complaint):
        in_process(link, *wish.split())


def test_the_figures_of_a_run_are_what_was_counted() -> None:
    figures = result(arrival(1.0), arrival(1.5, partial=True), arrival(1.6)).figures()
    assert (figures["frames_per_s"], figures["whole_frames"], figures["partial_frames"]) == (1.5, 2, 1)
    assert figures["stripes_ok_percent"] == pytest.approx(100 * 29 / 40)
    assert figures["longest_gap_ms"] == pytest.approx(500)
    assert figures["age_max_ms"] == pytest.approx(100)
    assert figures["command_p50_ms"] == pytest.approx(2)
    assert figures["passed"] is True


def test_one_wrong_stripe_one_doubled_command_or_one_damaged_object_fails_the_run() -> None:
    assert not result(arrival(1.0, wrong=1)).passed
    assert not result(arrival(1.0), run_twice=1).passed
    assert not result(arrival(1.0), transfer_wrong=True).passed


def test_recovery_is_the_longest_wait_after_the_end_of_a_spell() -> None:
    arrivals = [arrival(1.0), arrival(2.1), arrival(2.2), arrival(4.5)]
    assert recovery_s(arrivals, [2.0, 4.0]) == pytest.approx(0.5)
    assert recovery_s(arrivals, []) is None
    assert recovery_s(arrivals, [2.0, 5.0]) is None  # it never came back


def test_the_table_has_a_clean_line_at_three_speeds_every_fault_and_a_reboot() -> None:
    cases = standard_cases(BenchCase("any", seconds=2.0))
    assert [case.baud for case in cases if not case.faults and not case.reboot] == [3_000_000, 921_600, 115_200]
    assert {case.faults.partition("=")[0] for case in cases} >= {
        *("flips", "bits", "drops", "dups", "chunkdrop", "garbage", "stall", "baud", "cut", "replug")
    }
    assert sum(case.reboot for case in cases) == 1
    assert {case.seconds for case in cases} == {2.0}
