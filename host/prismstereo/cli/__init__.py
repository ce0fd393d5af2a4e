"""The command line `prismstereo`: verbs are loaded when they are called, errors become exit codes here and nowhere else.

Results go to stdout, progress and complaints to stderr. Exit codes: 0 ok, 1 measured but failed, 2 usage, 3 device, 4 data.
"""

from __future__ import annotations

import logging
import sys
from importlib import import_module

import click

from prismstereo_hw.errors import PrismStereoError

__all__ = ["VERBS", "cli", "main"]

VERBS = {
    "demo": "The main job with no hardware: simulated sensor, real firmware, depth picture, point cloud.",
    "design": "What the optics of a rig give, or the rig for a wish: baseline, range, camera.",
    "simulate": "Make a session with the optical twin: raw frames, board views, truth.",
    "target": "A calibration board to print, of exact size, that says itself which board it is.",
    "calibrate": "Solve the calibration of a unit from views of a board, and judge it.",
    "check": "Is a unit's calibration still good? A quick look from a few frames of any scene.",
    "refine": "Bring a calibration up to date from any textured scenes, or restore the former one.",
    "convert": "A calibration in the files of ROS, OpenCV, Kalibr, Luxonis or COLMAP, and back.",
    "align": "How a rig stands against its rig file: seam, vertical offset, vergence, focus balance.",
    "depth": "Raw frames to disparity, depth, point cloud and picture.",
    "measure": "Distances, planes, balls and heights in a frame, each with its standard deviation.",
    "quality": "How good depth is: fill rate, accuracy, noise, gap and levels, with a report to compare.",
    "reconstruct": "A metric mesh of every frame of a session or a recording, with its uncertainty.",
    "export": "A session or a recording for others: ROS 2 bag, PLY, GLB, LAS, 16-bit PNG, film, URDF.",
    "match": "One rectified pair to a disparity map.",
    "upsample": "A disparity map at the resolution of a still, depth edges where the still has them.",
    "view": "Watch a sensor, or a recording, in a browser: depth, point cloud, settings, recordings.",
    "devices": "List ports and the sensors on USB, or ask a sensor who and how it is.",
    "still": "One full-sensor picture, taken between two video frames.",
    "flash": "Give a sensor its calibration, read it back, and keep the one before.",
    "record": "Everything that a sensor sends, into a file that survives a power cut.",
    "replay": "Is a recording whole? Or its depth anew, by another matcher or calibration.",
    "recover": "Make a recording whole again that was cut or damaged.",
    "bench": "What the line between camera and desk stands, with faults on purpose.",
    "doctor": "Check this installation; with --bundle, gather what a bug report needs.",
}


class _LazyGroup(click.Group):
    """Knows every verb by name and one line; imports its module only when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        if cmd_name not in VERBS:
            return None
        command = import_module(f"prismstereo.cli.{cmd_name}").command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        del ctx
        with formatter.section("Verbs"):
            formatter.write_dl(list(VERBS.items()))


_HELP = """Single-camera stereo depth: one lens, one prism, two mirrors.

\b
Begin with:
  prismstereo demo                        the whole way with a simulated sensor
  prismstereo design oak-1                what a rig gives
  prismstereo calibrate VIEWS... --help   measure a built unit
"""  # \b keeps click from joining the lines below it


@click.group(
    cls=_LazyGroup,
    help=_HELP,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(package_name="prismstereo")
@click.option("-v", "--verbose", count=True, help="Say more on stderr; twice for everything.")
def cli(verbose: int) -> None:
    """Set up the log; the verbs do the rest."""
    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    logging.basicConfig(level=level, stream=sys.stderr, format="%(levelname)s %(name)s: %(message)s")


def main() -> None:
    """Run the command line; every complaint of ours is one line and an exit code."""
    try:
        code = cli.main(standalone_mode=False)
    except PrismStereoError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        click.echo("stopped", err=True)
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output has seen enough
        sys.stderr.close()
        sys.exit(0)
    sys.exit(code if isinstance(code, int) else 0)
