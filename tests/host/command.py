"""Run the command line as a user does, in a process of its own; or one verb in this process, where runs are to be quick."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import click
from click.testing import CliRunner


def prismstereo(*arguments: object, module: str = "prismstereo") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", module, *map(str, arguments)], capture_output=True, text=True, timeout=240, check=False
    )


def result_of(*arguments: object) -> dict[str, Any]:
    """Run with --json and return the object; anything but success shows the complaint."""
    done = prismstereo(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert isinstance(found, dict)
    return found


def complaint_of(code: int, *arguments: object, module: str = "prismstereo") -> str:
    """Run what must fail with an exit code; return its one line of complaint."""
    done = prismstereo(*arguments, module=module)
    assert done.returncode == code, (done.returncode, done.stderr)
    assert "Traceback" not in done.stderr
    lines = [line for line in done.stderr.splitlines() if line.lower().startswith("error:")]
    assert len(lines) == 1, done.stderr
    return lines[0]


def in_process(verb: click.Command, *arguments: object) -> tuple[int, str]:
    """Run a verb here; return its exit code and what it printed. What it raises goes on to the caller."""
    done = CliRunner().invoke(verb, [str(one) for one in arguments], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return int(done.return_value or 0), done.stdout
