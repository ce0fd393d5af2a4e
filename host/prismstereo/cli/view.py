"""`prismstereo view`: the live view in a browser."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from types import FrameType

import click

from prismstereo.cli.baud import baud_option
from prismstereo_hw.errors import UsageError

_BROWSER_PORT = 8710


@click.command(
    "view",
    epilog="Examples:  prismstereo view simulated\n\n           prismstereo view /dev/ttyACM0 --records today\n\n"
    "           prismstereo view today/20270102-030405.mcap",
)
@click.argument("target", required=False)
@click.option(
    "--host", "address", default="127.0.0.1", show_default=True, help="Address to listen on; others need a token."
)
@click.option(
    "--port", default=_BROWSER_PORT, show_default=True, type=click.IntRange(0, 65535), help="0: any free one."
)
@click.option(
    "--tls-cert", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="Certificate (PEM): https."
)
@click.option("--tls-key", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="Its private key (PEM).")
@click.option("--no-browser", is_flag=True, help="Print the address, open nothing.")
@click.option(
    "--records",
    default=Path("records"),
    show_default=True,
    type=click.Path(path_type=Path),
    help="Folder of recordings.",
)
@click.option("--rig", help="The unit's rig file, for captured sessions, where its rig is not a built-in one.")
@baud_option
def command(
    target: str | None, address: str, port: int, tls_cert: Path | None, tls_key: Path | None, no_browser: bool,
    records: Path, rig: str | None, baud: int | None,
) -> None:  # fmt: skip
    """Watch TARGET in a browser: depth, point cloud, settings, recordings.

    TARGET is a serial port, tcp:HOST:PORT, a recording (.mcap), or simulated[:RIG[:SCENE]]; without one, the sensor that is
    plugged in. Ends with Ctrl-C.
    """
    from prismstereo.opening import open_camera
    from prismstereo.viewer.hub import Hub
    from prismstereo.viewer.playback import Playback
    from prismstereo.viewer.records import Records
    from prismstereo.viewer.serving import ViewerServer
    from prismstereo_hw.rig import Rig

    if (tls_cert is None) != (tls_key is None):
        raise UsageError("a certificate and its key belong together: give --tls-cert and --tls-key")
    known = None if rig is None else Rig.read(rig)
    playback = Playback(Path(target)) if target is not None and target.endswith(".mcap") else None
    click.echo(f"opening {target or 'the sensor that is plugged in'}", err=True)
    hub = Hub(
        lambda: open_camera(target, baud=baud),
        target or "the sensor on USB",
        Records(records),
        playback=playback,
        rig=known,
    )
    with hub, ViewerServer(hub, address=address, port=port, certificate=tls_cert, key=tls_key) as server:
        click.echo(server.url)
        if server.access.token is not None:
            click.echo("others on this network can watch with this address, and only with all of it", err=True)
        if not no_browser:
            click.launch(server.url)
        _until_stopped()


def _until_stopped() -> None:
    """Wait for Ctrl-C, or for whoever ends programs on this machine: both end a recording in good order."""
    stopped = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        stopped.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    while not stopped.wait(0.5):
        pass
