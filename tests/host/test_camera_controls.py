from __future__ import annotations

import json
import struct
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from host.small_device import Answering, SmallDevice
from prismstereo.driver import StereoCamera
from prismstereo.requests import OutcomeUnknown
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import Held, ObjectNumber
from prismstereo_device.protocol import (
    Command,
    CommandReply,
    CommandStatus,
    Health,
    PictureKind,
    ZonesMessage,
    calibration_hash,
    picture_fragments,
)
from prismstereo_device.wire import Channel, WireError
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.errors import DataError, DeviceError, UsageError

PICTURE = np.random.default_rng(6).integers(0, 255, (48, 64), np.uint8)


REFUSALS = {
    ("do", "old", None): CommandReply(CommandStatus.STALE, why="too old"),
    ("do", "break", None): CommandReply(CommandStatus.FAILED, why="the sensor did not answer"),
    ("set", "exposure_us", 40_000): CommandReply(CommandStatus.REFUSED, why="give a number from 10 to 30000 us"),
}


class Desk(Answering):
    """A device with settings, stills, findings and a calibration."""

    def __init__(self) -> None:
        super().__init__(
            {ObjectNumber.CALIBRATION: Held(1, b"first"), ObjectNumber.FACTORY_CALIBRATION: Held(1, b"first")}
        )
        self.settings: dict[str, object] = {"exposure_us": 8000.0}
        self.still_state = '{"id": 0, "state": "none"}'
        self.png = cv2.imencode(".png", PICTURE)[1].tobytes()
        self.told = {"crop": [8, 0, 64, 48], "frame": 31, "timestamp_us": 5_000_000, "state": "ready"}

    def command(self, command: Command) -> CommandReply:
        self.ran.append([command.verb, command.name, command.value])
        match command.verb, command.name:
            case "get", "still":
                return CommandReply(CommandStatus.OK, self.still_state)
            case "do", "still":
                number = command.value[0]
                self.still_state = json.dumps({"id": number, **self.told, "size": len(self.png)})
                self.objects[ObjectNumber.STILL] = Held(number, self.png)
                return CommandReply(CommandStatus.OK, number)
            case "do", "self_test":
                self.objects[ObjectNumber.SELF_TEST] = Held(9, b'{"ok": true}')
                return CommandReply(CommandStatus.OK, value=True)
            case "do", "optics":
                return CommandReply(CommandStatus.BUSY, why="a look is being taken")
            case "do", "restore_calibration":
                self.objects[ObjectNumber.CALIBRATION] = self.objects[ObjectNumber.FACTORY_CALIBRATION]
                return CommandReply(CommandStatus.OK, value=True)
        return REFUSALS.get((command.verb, command.name, command.value)) or self._setting(command)

    def _setting(self, command: Command) -> CommandReply:
        if command.name not in self.settings:
            return CommandReply(CommandStatus.UNKNOWN, why=f"no setting {command.name}: there is exposure_us")
        if command.verb == "set":
            self.settings[command.name] = command.value
        return CommandReply(CommandStatus.OK, self.settings[command.name])

    def _written(self, request):
        progress = super()._written(request)
        if ObjectNumber.CALIBRATION in self.committed:
            self.objects[ObjectNumber.CALIBRATION] = Held(2, self.committed[ObjectNumber.CALIBRATION])
        return progress


@pytest.fixture
def desk() -> Iterator[tuple[Desk, SmallDevice, StereoCamera]]:
    device_end, host_end = loopback(mtu=512)
    answering = Desk()
    answering.mtu = 512
    with device_end, SmallDevice(device_end, answering=answering) as device, StereoCamera(host_end) as camera:
        yield answering, device, camera


def test_settings_are_asked_and_set(desk) -> None:
    _, _, camera = desk
    assert camera.get("exposure_us") == 8000.0
    assert camera.set("exposure_us", 9000.0) == 9000.0
    assert camera.get("exposure_us") == 9000.0


@pytest.mark.parametrize(
    ("verb", "name", "value", "error", "says"),
    [
        ("set", "exposure_us", 40_000, UsageError, "give a number from 10 to 30000 us"),
        ("get", "colour", None, UsageError, "get colour on loopback: no setting colour: there is exposure_us"),
        ("do", "break", None, DeviceError, "the sensor did not answer"),
        ("do", "old", None, OutcomeUnknown, "too old"),
        ("get", "No Name", None, UsageError, "'No Name'"),
        ("do", "count", "x" * 600, UsageError, "bytes, the line carries 512 at once"),
    ],
)
def test_what_the_camera_will_not_do_is_an_error_in_its_own_words(desk, verb, name, value, error, says) -> None:
    camera = desk[2]
    with pytest.raises(error, match=says):
        camera.get(name) if verb == "get" else getattr(camera, verb)(name, value)


def test_a_still_comes_with_its_pixels_its_frame_and_its_crop(desk) -> None:
    still = desk[2].still((8, 0, 64, 48))
    np.testing.assert_array_equal(still.pixels, PICTURE)
    assert (still.frame, still.timestamp_us, still.crop) == (31, 5_000_000, (8, 0, 64, 48))
    assert desk[0].ran[0][2][1:] == [8, 0, 64, 48]


def test_a_still_that_was_not_taken_says_why(desk) -> None:
    desk[0].told = {"state": "failed", "why": "the sensor takes no stills"}
    with pytest.raises(DeviceError, match="took no still: the sensor takes no stills"):
        desk[2].still()


def bomb() -> bytes:
    """A small PNG that claims 60000 x 60000 pixels."""
    small = cv2.imencode(".png", PICTURE)[1].tobytes()
    return small[:16] + struct.pack(">II", 60_000, 60_000) + small[24:]


@pytest.mark.parametrize(
    ("content", "says"),
    [(bomb(), "claims 60000x60000"), (b"\x89PNG\r\n\x1a\n" + bytes(20), "no whole"), (b"text", "no whole")],
)
def test_a_still_is_held_against_its_declared_size_before_it_is_decoded(desk, content: bytes, says: str) -> None:
    desk[0].png = content
    with pytest.raises(WireError, match=says):
        desk[2].still()


def test_findings_are_ordered_and_fetched(desk) -> None:
    desk[0].objects[ObjectNumber.IDENTITY] = Held(1, b'{"product": "prismstereo"}')
    desk[0].objects[ObjectNumber.OPTICS] = Held(1, b'{"dust": "none"}')
    desk[0].objects[ObjectNumber.LOG] = Held(1, b"one\ntwo\n")
    camera = desk[2]
    assert camera.self_test() == {"ok": True}
    assert camera.optics(timeout_s=0.1) == {"dust": "none"}
    assert camera.identity_details == {"product": "prismstereo"}
    assert camera.log() == "one\ntwo\n"


def test_findings_that_cannot_be_read_are_an_error(desk) -> None:
    desk[0].objects[ObjectNumber.IDENTITY] = Held(1, b"[" * 100_000)
    with pytest.raises(WireError, match="identity of loopback cannot be read"):
        _ = desk[2].identity_details


def test_a_calibration_that_is_written_is_the_one_in_use_and_the_first_can_be_restored(desk) -> None:
    camera = desk[2]
    assert camera.calibration_bytes == b"first"
    camera.write_calibration(b"second" * 100)
    assert camera.calibration_bytes == b"second" * 100
    assert camera.restore_calibration() == b"first"
    assert camera.calibration_bytes == b"first"


def test_an_update_is_sent_whole(desk) -> None:
    desk[2].send_update(bytes(range(256)) * 40)
    assert desk[0].committed == {ObjectNumber.UPDATE: bytes(range(256)) * 40}


def test_pictures_zones_and_health_arrive_on_streams_of_their_own(desk) -> None:
    _, device, camera = desk
    zones = ZoneDistances(7, 900, np.array([[400, 0], [65535, 1200]], np.uint16), floor_removed=True)
    with (
        camera.stream(Channel.IMG) as previews,
        camera.stream(Channel.ZONES) as nearest,
        camera.stream(Channel.HEALTH) as health,
    ):
        for flags, frag, payload in picture_fragments(
            PICTURE, kind=PictureKind.PREVIEW, frame=7, timestamp_us=900, mtu=512
        ):
            device.send(Channel.IMG, payload, flags, 7, frag)
        device.send(Channel.ZONES, ZonesMessage(zones).pack())
        device.send(Channel.HEALTH, Health(1, 2, 3, 4, 5, 6, 7).pack())
        picture = previews.take(2.0)
        assert picture is not None
        assert (picture.head.frame, picture.pixels().shape) == (7, (48, 64))
        np.testing.assert_array_equal(next(nearest).nearest_mm, zones.nearest_mm)
        assert next(health).frames_sent == 2
    assert previews.take(0.01) is None
    assert list(nearest) == []


def test_a_slow_reader_of_a_stream_has_the_newest(desk) -> None:
    _, device, camera = desk
    with camera.stream(Channel.HEALTH, newest=2) as health:
        for sent in range(5):
            device.send(Channel.HEALTH, Health(0, sent, 0, 0, 0, 0, 0).pack())
        camera.get("exposure_us")  # answered behind them
        assert [next(health).frames_sent, next(health).frames_sent, health.not_taken] == [3, 4, 3]


def test_a_stream_ends_with_the_camera(desk) -> None:
    camera = desk[2]
    stream = camera.stream(Channel.IMG)
    camera.close()
    assert list(stream) == []


def test_a_channel_that_is_no_stream_is_refused(desk) -> None:
    with pytest.raises(UsageError, match="channel DISP cannot be read as a stream"):
        desk[2].stream(Channel.DISP)


def test_a_camera_of_an_older_kind_is_asked_for_nothing_it_cannot_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("host.small_device.ABLE", 0)
    device_end, host_end = loopback()
    with device_end, SmallDevice(device_end) as device, StereoCamera(host_end) as camera:
        with pytest.raises(UsageError, match="takes no commands: its firmware is older"):
            camera.set("exposure_us", 1.0)
        with pytest.raises(UsageError, match="takes no calibration"):
            camera.write_calibration(b"bytes")
    assert device.answering.ran == []


def test_a_calibration_other_than_the_announced_one_is_refused_by_name(desk) -> None:
    desk[0].objects[ObjectNumber.CALIBRATION] = Held(5, b"another")
    with pytest.raises(DataError, match=f"has hash {calibration_hash(b'another').hex()}, asked for was"):
        _ = desk[2].calibration_bytes
