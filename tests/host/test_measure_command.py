"""`prismstereo measure`: lengths in the frame of a session, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from host.calibrated_source import Wall
from host.command import in_process
from host.recorded import session_note
from prismstereo.cli.measure import command
from prismstereo.recording.journal import Journal
from prismstereo.recording.output import FileOutput
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.store import write
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import calibration_hash, fragment
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import UsageError
from prismstereo_hw.files import write_picture
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.session import SessionWriter
from prismstereo_hw.twin import Twin

PLANE_MM = 500.0


@pytest.fixture(scope="module")
def session(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One frame of a facing plane, and its calibration."""
    folder = tmp_path_factory.mktemp("plane") / "session"
    twin = Twin(small, facing_plane(small, PLANE_MM))
    writer = SessionWriter(folder, small, f"plane:{PLANE_MM:g}")
    writer.add("video", twin.frame())
    write(folder / "calibration.json", Calibration.nominal(small))
    writer.finish()
    return folder


def told(*arguments: object) -> dict[str, object]:
    code, text = in_process(command, *arguments, "--json")
    assert code == 0
    found = json.loads(text)
    assert isinstance(found, dict)
    return found


def test_a_plane_is_found_with_its_sigma(session: Path, pinhole_of_small_mm: float) -> None:
    found = told(session, "--plane", "60,50,60,80")
    assert found["value_mm"] == pytest.approx(PLANE_MM - pinhole_of_small_mm, abs=3 * found["sigma_mm"])
    assert 0 < found["sigma_mm"] < 5
    assert found["calibration_mm"] is None
    assert found["tilt_deg"] < 3
    _, text = in_process(command, session, "--plane", "60,50,60,80")
    assert "the calibration does not say how well it is known" in text


def test_points_and_heights_are_told_in_mm(session: Path, small: Rig) -> None:
    length = told(session, "--points", "60,60", "110,60")
    focal_px = Calibration.nominal(small).focal_px
    assert length["what"] == "distance"
    assert length["value_mm"] == pytest.approx(50 / focal_px * PLANE_MM, rel=0.1)
    height = told(session, "--height-over", "60,50,60,80", "--at", "90,90")
    assert abs(height["value_mm"]) <= 4 * height["sigma_mm"]


def test_a_picture_is_measured_by_a_calibration(session: Path, tmp_path: Path) -> None:
    picture = session / "video" / "000000.png"
    found = told(picture, "--calibration", session / "calibration.json", "--plane", "60,50,60,80")
    assert found["value_mm"] == told(session, "--plane", "60,50,60,80")["value_mm"]
    with pytest.raises(UsageError, match="give the unit's with --calibration"):
        in_process(command, picture, "--plane", "60,50,60,80")


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ((), "say what to measure"),
        (("--plane", "1,2,3,4", "--sphere", "1,2,3,4"), "say what to measure"),
        (("--plane", "1,2,3"), "X,Y,WIDTH,HEIGHT"),
        (("--plane", "1,2,3,-4"), "X,Y,WIDTH,HEIGHT"),
        (("--plane", "1,2,0,4"), "holds no pixel"),
        (("--plane", "9000,2,30,40"), "reaches out of the map"),
        (("--points", "1,x", "2,3"), "give X,Y"),
        (("--points", "nan,4", "2,3"), "outside of the map"),
        (("--height-over", "1,2,30,40"), "go together"),
        (("--at", "1,2", "--plane", "1,2,3,4"), "go together"),
        (("--plane", "60,50,60,80", "--frame", "7"), "has no frame 7"),
        (("--sphere", "60,50,60,80"), "no ball"),
    ],
)
def test_what_cannot_be_measured_is_one_clear_sentence(session: Path, wrong: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        in_process(command, session, *wrong)


def test_a_calibration_of_another_rig_is_refused(session: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.json"
    write(other, Calibration.nominal(Rig.read("dslr-35mm")))
    with pytest.raises(CalibrationError, match="the calibration of the same rig"):
        in_process(command, session, "--calibration", other, "--plane", "60,50,60,80")


def test_a_frame_of_nothing_has_nothing_to_measure(session: Path, small: Rig, tmp_path: Path) -> None:
    dark = tmp_path / "dark.png"
    write_picture(dark, np.zeros((small.camera.video.height, small.camera.video.width), np.uint8))
    with pytest.raises(UsageError, match="nothing was matched"):
        in_process(command, dark, "--calibration", session / "calibration.json", "--points", "60,60", "90,60")


@pytest.fixture(scope="module")
def pinhole_of_small_mm(small: Rig) -> float:
    """How far in front of the entrance pupil depth is counted from."""
    view = fold(small, "left")
    return float((view.paraxial_centre_mm + Calibration.nominal(small).nearest_pinholes().shift * view.R[2])[2])


def test_a_recording_is_measured_as_it_was_matched(small: Rig, tmp_path: Path) -> None:
    wall = Wall(Calibration.nominal(small), 600.0)
    path = tmp_path / "wall.mcap"
    journal = begin_with(FileOutput(path), wall.content)
    named = calibration_hash(wall.content)
    for index in range(3):
        parts = fragment(
            wall.disparity, frame=index, timestamp_us=1000 * index, calibration_hash=named, mtu=1024, bound=0
        )
        for flags, number, payload in parts:
            packet = Packet(Channel.DISP, payload, flags, number & 0xFFFF, index & 0xFFFF, number)
            journal.write(StoredPacket(packet, 1_000_000 + 66_667 * index, 1))
    journal.finish()
    found = told(path, "--plane", "60,50,60,80", "--frame", "1")
    assert found["value_mm"] == pytest.approx(600.0, abs=3 * found["sigma_mm"])
    with pytest.raises(UsageError, match="leave --calibration"):
        in_process(command, path, "--plane", "60,50,60,80", "--matcher", "tiles")


def begin_with(output: FileOutput, content: bytes) -> Journal:
    """A recording of one session whose camera holds a calibration."""
    journal = Journal(output, 0.0)
    journal.describe({"label": "of a test"})
    journal.identify({"serial": "serial-1"})
    journal.calibrate(content)
    journal.write(session_note(content=content))
    return journal
