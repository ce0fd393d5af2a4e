"""`prismstereo demo`: the main job with no hardware."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say, with_progress
from prismstereo_hw.errors import DeviceError

if TYPE_CHECKING:
    from prismstereo.driver import StereoCamera
    from prismstereo_calibration.rectification import Rectification
    from prismstereo_device.protocol import ReceivedFrame
    from prismstereo_hw.twin import Twin


@click.command("demo", epilog="Example:  prismstereo demo --rig dslr-35mm --scene plane:700 --frames 5 -o out")
@click.option("--rig", default="oak-1", show_default=True, help="Rig of the simulated sensor.")
@click.option(
    "--scene", default="desk", show_default=True, help="desk, face, toy-car, street, plane:MM, sphere:MM or board:MM."
)
@click.option("--frames", default=12, show_default=True, type=click.IntRange(1, 10_000), help="Frames to receive.")
@click.option(
    "--port", help="A sensor that runs already, or a recording (see `prismstereo devices`), for the simulated one."
)
@click.option("--out", "-o", default="demo", show_default=True, type=click.Path(path_type=Path), help="Results folder.")
@click.option("--headless", is_flag=True, help="End by itself, and say no more than the result.")
@json_option
def command(rig: str, scene: str, frames: int, port: str | None, out: Path, headless: bool, as_json: bool) -> None:
    """Run simulated sensor, real firmware in a second process, serial line and host; write what comes out.

    OUT gets the last frame's depth.png, disparity.pfm and cloud.ply.
    """
    received = _from_port(port, frames) if port else _simulated(rig, scene, frames)
    result = received.write(out)
    say(result, received.lines(out), as_json=as_json)
    if not headless:
        click.echo(f"see it live in a browser: prismstereo view {port or f'simulated:{rig}:{scene}'}", err=True)
    if received.lost is not None:
        raise received.lost


class _Received:
    """What came in, how far it is from the truth, and what cut it short."""

    def __init__(self, twin: Twin | None) -> None:
        self.twin = twin
        self.frames = 0
        self.last: ReceivedFrame | None = None
        self.errors_mm: list[float] = []
        self.errors_px: list[float] = []
        self.sent: object = None
        self.bad_packets = 0
        self.received_bytes = 0
        self.lost: DeviceError | None = None
        self.rectification: Rectification | None = None

    def take(self, camera: StereoCamera, most: int) -> None:
        """Receive up to `most` frames; a device that goes away ends it, and what came before is kept."""
        from prismstereo_calibration.rectification import rectification

        self.rectification = rectification(camera.calibration)
        try:
            for frame in with_progress(islice(camera, most), most, "frames received"):
                self.frames += 1
                self.last = frame
                self._judge(frame)
        except DeviceError as error:
            self.lost = error
        statistics = camera.statistics
        self.bad_packets, self.received_bytes = statistics.line.bad, statistics.line.received_bytes

    def _judge(self, frame: ReceivedFrame) -> None:
        import numpy as np

        from prismstereo_calibration.truth import true_disparity

        if self.twin is None or self.rectification is None:
            return
        truth = true_disparity(self.twin.truth(frame.index), self.rectification)
        window = self.rectification.window
        error_px = np.abs(frame.disparity.disparity_px - truth)
        error_mm = np.abs(window.depth_map(frame.disparity.disparity_px) - window.depth_map(truth))
        both = np.isfinite(error_mm)
        if both.any():
            self.errors_px.append(float(np.median(error_px[both])))
            self.errors_mm.append(float(np.median(error_mm[both])))

    def write(self, out: Path) -> dict[str, object]:
        """Write the last frame and return the result; `DeviceError` when no frame came at all."""
        from statistics import median

        from prismstereo.cloud import point_cloud
        from prismstereo.picture import depth_picture, disparity_colours
        from prismstereo_hw import pfm
        from prismstereo_hw.files import write_picture

        if self.last is None or self.rectification is None:
            raise self.lost or DeviceError("the sensor sent no frame: look at its log")
        disparity = self.last.disparity
        pfm.write_disparity(out / "disparity.pfm", disparity.disparity_px)
        write_picture(out / "depth.png", depth_picture(disparity, self.rectification.unit))
        cloud = point_cloud(disparity, self.rectification, disparity_colours(disparity))
        cloud.write(out / "cloud.ply")
        self.points = len(cloud.points)
        return {
            "frames_sent": self.sent,
            "frames_received": self.frames,
            "bad_packets": self.bad_packets,
            "received_bytes": self.received_bytes,
            "density": disparity.density,
            "points": self.points,
            "depth_error_mm": median(self.errors_mm) if self.errors_mm else None,
            "disparity_error_px": median(self.errors_px) if self.errors_px else None,
            "files": [out / name for name in ("depth.png", "disparity.pfm", "cloud.ply")],
        }

    def lines(self, out: Path) -> list[str]:
        """Say the same to people."""
        from statistics import median

        sent = "" if self.sent is None else f"{self.sent} frames sent, "
        lines = [
            f"{sent}{self.frames} frames received, {self.bad_packets} bad packets, {self.received_bytes / 1e6:.1f} MB",
            f"{out / 'depth.png'}, {out / 'disparity.pfm'}, {out / 'cloud.ply'} ({self.points} points)",
        ]
        if self.errors_mm:
            lines.insert(
                1,
                f"depth error against truth: median {median(self.errors_mm):.2f} mm ({median(self.errors_px):.3f} px)",
            )
        return lines


def _simulated(rig_name: str, scene: str, frames: int) -> _Received:
    from prismstereo.driver import StereoCamera
    from prismstereo.simulated import SimulatedDevice
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.scene import named
    from prismstereo_hw.twin import Twin

    rig = Rig.read(rig_name)
    received = _Received(Twin(rig, named(rig, scene)))
    click.echo(f"starting the firmware with a simulated {rig.name} before {scene}", err=True)
    with SimulatedDevice(f"twin:{rig_name}:{scene}", frames=frames) as device:
        click.echo(f"the firmware listens on {device.address}", err=True)
        with StereoCamera.open(device.address, timeout_s=30.0, keep_all=True, reconnect=False) as camera:
            received.take(camera, frames)
    received.sent = device.statistics.get("sent")
    return received


def _from_port(port: str, frames: int) -> _Received:
    from prismstereo.opening import open_camera

    received = _Received(None)
    with open_camera(port, reconnect=False) as camera:
        received.take(camera, frames)
    return received
