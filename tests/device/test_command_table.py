"""Commands by name: every one is answered at once, repeats are harmless, and refusals say what would be granted."""

from __future__ import annotations

import string
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from device.small_camera import AtOnce, DrawnSensor, SmallCamera
from prismstereo_device.control.command_table import ACTIONS, CommandTable, Machine
from prismstereo_device.control.settings import Settings
from prismstereo_device.objects import Progress, WriteStatus
from prismstereo_device.protocol.command import Command, CommandReply, CommandStatus, Value, Verb


class Desk:
    """A command table over a small camera, and what it did to the machine."""

    def __init__(self, restored: Progress | None = None) -> None:
        self.camera = SmallCamera(DrawnSensor())
        self.bounds: list[int | None] = []
        self.restores = 0
        self.rebooted = Event()
        self.restored = restored or Progress(WriteStatus.OK)
        machine = Machine(
            77, lambda: 41.5, self.bounds.append, self._restore, self.rebooted.set, self.camera.sensor.modes
        )
        self.table = CommandTable(self.camera.controls, self.camera.stills, self.camera.optics, machine, AtOnce())

    def _restore(self) -> Progress:
        self.restores += 1
        return self.restored

    def say(self, verb: Verb, name: str, value: Value = None) -> CommandReply:
        return self.table.answer(Command(verb, name, value))


@pytest.fixture(scope="module")
def desk() -> Desk:
    return Desk()


def test_every_setting_can_be_asked_for_and_set_to_what_it_is(desk: Desk) -> None:
    for name in Settings.__struct_fields__:
        told = desk.say("get", name)
        assert told.status is CommandStatus.OK
        if told.value != "auto":
            assert desk.say("set", name, told.value) == told


def test_a_set_answers_with_what_is_in_force(desk: Desk) -> None:
    assert desk.say("set", "exposure_us", 8000) == CommandReply(CommandStatus.OK, 8000.0)
    assert desk.say("get", "exposure_us") == CommandReply(CommandStatus.OK, 8000.0)
    assert desk.say("set", "exposure_us", 40_000).status is CommandStatus.REFUSED
    assert desk.say("get", "exposure_us") == CommandReply(CommandStatus.OK, 8000.0)


def test_the_bound_goes_to_the_rate_control_at_once() -> None:
    desk = Desk()
    for value, bound in ((2, 2), (0, 0), ("auto", None)):
        assert desk.say("set", "bound", value) == CommandReply(CommandStatus.OK, value)
        assert desk.bounds[-1] == bound
    desk.say("set", "bound", 3)
    assert desk.bounds == [2, 0, None]


def test_what_the_camera_knows_can_only_be_asked_for(desk: Desk) -> None:
    assert desk.say("get", "boot_id").value == 77
    assert desk.say("get", "temperature_c").value == 41.5
    uptime_s = desk.say("get", "uptime_s").value
    assert isinstance(uptime_s, float)
    assert 0 <= uptime_s < 600
    assert desk.say("set", "boot_id", 1) == CommandReply(
        CommandStatus.REFUSED, why="boot_id can only be asked for: use get"
    )


@pytest.mark.parametrize("verb", ["get", "set", "do"])
def test_an_unknown_name_is_answered_with_the_names_there_are(desk: Desk, verb: Verb) -> None:
    told = desk.say(verb, "flux")
    assert told.status is CommandStatus.UNKNOWN
    assert told.why.startswith("there is no flux here: ")
    assert ("restore_calibration" if verb == "do" else "exposure_us") in told.why


def test_a_still_is_asked_for_once_however_often_the_request_comes() -> None:
    desk = Desk()
    for _ in range(3):
        assert desk.say("do", "still", [5, 0, 0, 640, 480]) == CommandReply(CommandStatus.OK, 5)
    assert desk.say("do", "still", [6]).status is CommandStatus.BUSY
    desk.camera.source.read()
    desk.camera.source.read()
    assert desk.say("do", "still", [5]) == CommandReply(CommandStatus.OK, 5)
    assert len(desk.camera.held) == 1
    told = desk.say("get", "still").value
    assert isinstance(told, str)
    assert msgspec.json.decode(told)["state"] == "ready"
    assert desk.say("do", "still", [6]) == CommandReply(CommandStatus.OK, 6)


@pytest.mark.parametrize(
    ("value", "why"),
    [
        (None, "give [number] or [number, x, y, width, height]"),
        ([], "give [number]"),
        ([1, 2], "give [number]"),
        (7, "give [number]"),
        ([0], "number it from 1 to 4294967295"),
        ([1, 0, 0, 641, 480], r"crop [0, 0, 641, 480] leaves the sensor: give x, y, width, height inside 640x480"),
        ([1, -1, 0, 10, 10], "leaves the sensor"),
        ([1, 0, 0, 0, 10], "leaves the sensor"),
    ],
)
def test_a_still_that_cannot_be_is_refused_at_once(desk: Desk, value: Value, why: str) -> None:
    told = desk.say("do", "still", value)
    assert told.status is CommandStatus.REFUSED
    assert why in told.why


def test_a_self_test_is_done_between_frames_one_at_a_time() -> None:
    desk = Desk()
    assert desk.say("do", "self_test").status is CommandStatus.OK
    assert desk.say("do", "self_test").status is CommandStatus.BUSY
    desk.camera.source.read()
    desk.camera.source.read()
    assert len(desk.camera.facts) == 1
    assert desk.say("do", "self_test").status is CommandStatus.OK


def test_the_factory_calibration_is_restored_apart_from_the_answer(caplog: pytest.LogCaptureFixture) -> None:
    desk = Desk()
    assert desk.say("do", "restore_calibration") == CommandReply(CommandStatus.OK, value=True)
    assert desk.restores == 1
    poor = Desk(Progress(WriteStatus.REFUSED, why="there is no factory calibration"))
    poor.say("do", "restore_calibration")
    assert "the factory calibration was not restored: there is no factory calibration" in caplog.text


def test_a_slow_disk_delays_no_answer() -> None:
    camera, disk = SmallCamera(DrawnSensor()), Event()

    def restore() -> Progress:
        disk.wait(10)
        return Progress(WriteStatus.OK)

    with ThreadPoolExecutor(1) as worker:
        machine = Machine(1, lambda: None, lambda bound: None, restore, lambda: None)
        table = CommandTable(camera.controls, camera.stills, camera.optics, machine, worker)
        begin_s = time.monotonic()
        assert table.answer(Command("do", "restore_calibration")).status is CommandStatus.OK
        assert table.answer(Command("do", "restore_calibration")).status is CommandStatus.BUSY
        assert time.monotonic() - begin_s < 1
        disk.set()


def test_a_reboot_is_asked_of_the_program() -> None:
    desk = Desk()
    assert desk.say("do", "reboot") == CommandReply(CommandStatus.OK, value=True)
    assert desk.rebooted.is_set()


def test_every_action_is_described() -> None:
    assert set(ACTIONS) == {"still", "self_test", "optics", "reboot", "restore_calibration"}


_NAMES = st.one_of(
    st.sampled_from([*Settings.__struct_fields__, "still", "uptime_s", "self_test", "optics", "restore_calibration"]),
    st.text(string.ascii_lowercase + "_", min_size=1, max_size=32),
)
_VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=40), st.lists(st.integers(), max_size=6)
)


@given(verb=st.sampled_from(["get", "set", "do"]), name=_NAMES.filter(lambda name: name != "reboot"), value=_VALUES)
def test_no_command_raises_and_every_answer_fits_a_packet(desk: Desk, verb: Verb, name: str, value: Value) -> None:
    told = desk.say(verb, name, value)
    assert len(told.pack()) <= 240
    assert (told.status is CommandStatus.OK) is (told.why == "")
