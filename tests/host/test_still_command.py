from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.command import in_process
from host.small_device import SmallDevice
from host.test_camera_controls import PICTURE, Desk
from prismstereo.cli.still import command
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_hw.errors import DeviceError, UsageError


@pytest.fixture
def sensor() -> Iterator[tuple[Desk, str]]:
    desk = Desk()
    with PtyPort() as link, SmallDevice(link, answering=desk):
        yield desk, link.name


def test_a_still_is_written_as_it_came_with_its_place_and_its_frame(sensor, tmp_path: Path) -> None:
    desk, port = sensor
    out = tmp_path / "still.png"

    code, text = in_process(command, port, "-o", out, "--crop", "8,0,64,48", "--json")

    assert code == 0
    assert out.read_bytes() == desk.png
    told = json.loads(text)
    assert (told["width_px"], told["height_px"], told["crop_px"]) == (64, 48, [8, 0, 64, 48])
    assert (told["frame"], told["timestamp_us"], told["received_bytes"]) == (31, 5_000_000, len(desk.png))
    assert desk.ran[0][:2] == ["do", "still"]
    assert desk.ran[0][2][1:] == [8, 0, 64, 48]


def test_another_form_of_picture_is_made_of_its_pixels(sensor, tmp_path: Path) -> None:
    in_process(command, sensor[1], "-o", tmp_path / "still.jpg")

    pixels = cv2.imread(str(tmp_path / "still.jpg"), cv2.IMREAD_GRAYSCALE)
    assert pixels.shape == PICTURE.shape
    assert np.abs(pixels.astype(int) - PICTURE).mean() < 20


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-o", "still.tif"], "end it in .png, .jpg, .jpeg"),
        (["-o", "still.png", "--crop", "1,2,3"], "give X,Y,WIDTH,HEIGHT"),
        (["-o", "still.png", "--crop", "1,2,3,-4"], "give X,Y,WIDTH,HEIGHT"),
    ],
)
def test_a_wish_that_makes_no_sense_is_refused_before_a_port_is_opened(arguments: list[str], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        in_process(command, "/dev/ttyNOWHERE", *arguments)


def test_a_still_that_fails_leaves_no_file(sensor, tmp_path: Path) -> None:
    desk, port = sensor
    desk.told = {"state": "failed", "why": "the camera is away"}

    with pytest.raises(DeviceError, match="the camera is away"):
        in_process(command, port, "-o", tmp_path / "still.png")

    assert list(tmp_path.iterdir()) == []
