"""`prismstereo bench`: what the parts of the sensor do under load. `bench link` is the line between camera and desk."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import click

from prismstereo.cli.output import json_option, say

if TYPE_CHECKING:
    from prismstereo.link_bench.bench_case import BenchCase
    from prismstereo.link_bench.bench_result import BenchResult

_COLUMNS = (
    ("frames_per_s", "frames/s", 8, 1),
    ("whole_frames", "whole", 6, 0),
    ("partial_frames", "partial", 7, 0),
    ("halved_frames", "halved", 6, 0),
    ("mean_bound", "bound", 5, 1),
    ("stripes_ok_percent", "stripes%", 8, 1),
    ("wrong_stripes", "WRONG", 5, 0),
    ("age_p50_ms", "age ms", 6, 0),
    ("age_max_ms", "max", 5, 0),
    ("command_p50_ms", "cmd ms", 6, 1),
    ("command_p99_ms", "p99", 5, 0),
    ("command_max_ms", "max", 5, 0),
    ("commands_unknown", "unknown", 7, 0),
    ("longest_gap_ms", "gap ms", 6, 0),
    ("recovery_s", "recover s", 9, 2),
    ("upload_s", "up s", 5, 2),
    ("download_s", "down s", 6, 2),
    ("sessions", "sessions", 8, 0),
)


_LINK_HELP = """Run the firmware's service and the desk's camera over a line that goes wrong on purpose.

Nothing wrong may be taken for right, whatever the line does: frames are known at both ends, and any difference is counted
as WRONG (exit code 1). Faults of both directions, or of one with `up:` or `down:` before them:

\b
  flips, drops, dups   share of the bytes changed, lost, doubled         flips=1e-4
  bits                 share of the bits turned over                     bits=1e-5
  chunkdrop, garbage   share of the runs of bytes lost, or followed by bytes that nobody sent
  stall, cut, baud     D seconds of every P: nothing moves, the line is dead, wrong speed    stall=0.2/1
  replug               the same for the host's plug                      replug=0.2/2
  slow                 bytes per second, in place of --line's
"""


@click.group("bench")
def command() -> None:
    """Measure the sensor's parts on this computer."""


@command.command(
    "link", help=_LINK_HELP, epilog="Example:  prismstereo bench link --faults flips=1e-4,stall=0.2/1 --seconds 6"
)
@click.option("--faults", default="", metavar="PLAN", help="kind=value,...; see below.")
@click.option("--line", "baud", default=3_000_000, show_default=True, metavar="BAUD", help="Speed, 10 bits a byte.")
@click.option("--seconds", default=6.0, show_default=True, type=click.FloatRange(0.2, 3600), help="Length of a run.")
@click.option("--size", default="640x360", show_default=True, metavar="WxH", help="Size of the frames.")
@click.option(
    "--rate", "rate_hz", default=15.0, show_default=True, type=click.FloatRange(0.1, 200), help="Frames/s made."
)
@click.option(
    "--bound", default="1", show_default=True, type=click.Choice(["0", "1", "2", "4", "auto"]), help="Error in 1/16 px."
)
@click.option("--tcp", is_flag=True, help="TCP in place of a pseudo-terminal.")
@click.option("--reboot", is_flag=True, help="Kill the far end half-way and start it again.")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="Of the faults.")
@click.option("--all", "every", is_flag=True, help="The whole table: a clean line at three speeds, then every fault.")
@json_option
def link(
    *,
    faults: str,
    baud: int,
    seconds: float,
    size: str,
    rate_hz: float,
    bound: str,
    tcp: bool,
    reboot: bool,
    seed: int,
    every: bool,
    as_json: bool,
) -> int:
    """Run the firmware's service and the desk's camera over a line that goes wrong on purpose."""
    from prismstereo.link_bench.bench_case import BenchCase, standard_cases

    width, height = _size(size)
    kind: Literal["pty", "tcp"] = "tcp" if tcp else "pty"
    case = BenchCase(
        name=faults or ("killed and restarted" if reboot else "clean"),
        faults=faults,
        baud=baud,
        seconds=seconds,
        width=width,
        height=height,
        rate_hz=rate_hz,
        bound=None if bound == "auto" else int(bound),
        kind=kind,
        reboot=reboot,
        seed=seed,
    )
    return _run(standard_cases(case) if every else [case], as_json=as_json)


def _run(cases: list[BenchCase], *, as_json: bool) -> int:
    """Run cases and print a row for each as it is there; 1 if one of them failed."""
    from prismstereo.link_bench.run import run_case

    results: list[tuple[BenchCase, BenchResult]] = []
    if not as_json:
        click.echo(_head())
    for number, case in enumerate(cases, start=1):
        click.echo(f"{number} of {len(cases)}: {case.name}", err=True)
        results.append((case, run_case(case)))
        if not as_json:
            click.echo(_row(*results[-1]))
    if as_json:
        say({"cases": [_entry(*one) for one in results]}, (), as_json=True)
    return 0 if all(result.passed for _, result in results) else 1


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and 16 <= int(width) <= 2048 and 16 <= int(height) <= 2048):
        raise click.BadParameter(f"{text!r}: give WIDTHxHEIGHT, 16 to 2048 each, e.g. 640x360", param_hint="--size")
    return int(width), int(height)


def _entry(case: BenchCase, result: BenchResult) -> dict[str, object]:
    line = {"name": case.name, "faults": case.faults, "baud": case.baud, "link": case.kind, "seconds": case.seconds}
    frames = {"width": case.width, "height": case.height, "rate_hz": case.rate_hz, "bound": case.bound}
    return {**line, **frames, **result.figures()}


def _head() -> str:
    return "case".ljust(24) + "".join(f"  {title:>{width}}" for _, title, width, _ in _COLUMNS)


def _row(case: BenchCase, result: BenchResult) -> str:
    figures = result.figures()
    cells = (f"  {_cell(figures[key], digits):>{width}}" for key, _, width, digits in _COLUMNS)
    return case.name[:24].ljust(24) + "".join(cells)


def _cell(value: object, digits: int) -> str:
    return f"{value:.{digits}f}" if isinstance(value, int | float) else "-"
