"""`prismstereo recover`: a recording that was cut or damaged, made whole again."""

from __future__ import annotations

from pathlib import Path

import click

from prismstereo.cli.output import json_option, say


@click.command("recover", epilog="Example:  prismstereo recover cut.mcap -o whole.mcap")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="The new file; must not exist yet.")
@json_option
def command(file: Path, out: Path, as_json: bool) -> None:
    """Bring everything that can be read of FILE into a new recording with an index.

    Packets are held against their own check sums, the rest against that of its chunk. FILE itself stays as it is.
    """
    from prismstereo.recording import recover

    done = recover(file, out)
    damage = done.damage
    result: dict[str, object] = {
        "file": out,
        "packets": done.packets,
        "messages": done.messages,
        "seconds": done.seconds,
        "packets_damaged": damage.packets,
        "chunks_damaged": damage.chunks,
        "notes_damaged": damage.notes,
        "why_cut": done.why_cut or None,
    }
    lines = [
        f"{out}: {done.packets} packets and {done.messages} other messages, {done.seconds:.1f} s",
        f"{damage.packets} packets, {damage.notes} notes and pictures and parts of {damage.chunks} chunks could not be saved",
    ]
    if done.why_cut:
        lines.append(f"{file} was cut: {done.why_cut}")
    say(result, lines, as_json=as_json)
