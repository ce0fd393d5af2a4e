from __future__ import annotations

import logging
from pathlib import Path

import pytest

from prismstereo_device.serving.status_led import FolderLed, LedState, NoLed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A lamp's folder as the kernel makes it, with the timer trigger."""
    for name, content in (("trigger", "none [mmc0] timer\n"), ("max_brightness", "255\n"), ("brightness", "0\n")):
        (tmp_path / name).write_text(content, "ascii")
    return tmp_path


def shown(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text("ascii") for path in folder.iterdir()}


@pytest.mark.parametrize("state", [LedState.STARTING, LedState.WAITING, LedState.FAULT])
def test_the_kernel_blinks_in_the_states_own_rhythm(folder: Path, state: LedState) -> None:
    FolderLed(folder).show(state)
    files = shown(folder)
    assert files["trigger"] == "timer"
    assert (int(files["delay_on"]), int(files["delay_off"])) == state.value


def test_every_blinking_state_has_a_rhythm_of_its_own() -> None:
    assert len({state.value for state in LedState}) == len(LedState)


def test_a_camera_that_streams_is_lit(folder: Path) -> None:
    FolderLed(folder).show(LedState.STREAMING)
    assert (shown(folder)["trigger"], shown(folder)["brightness"]) == ("none", "255")


def test_a_camera_that_stopped_is_dark(folder: Path) -> None:
    led = FolderLed(folder)
    led.show(LedState.WAITING)
    led.show(LedState.OFF)
    assert (shown(folder)["trigger"], shown(folder)["brightness"]) == ("none", "0")


def test_a_state_that_is_shown_is_not_written_again(folder: Path) -> None:
    led = FolderLed(folder)
    led.show(LedState.STREAMING)
    (folder / "brightness").write_text("7", "ascii")
    led.show(LedState.STREAMING)
    assert shown(folder)["brightness"] == "7"


def test_a_lamp_without_timer_is_lit_while_frames_are_sent_and_dark_otherwise(folder: Path) -> None:
    (folder / "trigger").write_text("[none] mmc0\n", "ascii")
    led = FolderLed(folder)
    led.show(LedState.STREAMING)
    assert shown(folder)["brightness"] == "255"
    led.show(LedState.FAULT)
    assert shown(folder)["brightness"] == "0"


def test_a_lamp_that_cannot_be_set_is_given_up_after_one_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    led = FolderLed(tmp_path / "absent")
    with caplog.at_level(logging.WARNING):
        for state in LedState:
            led.show(state)
    assert len(caplog.records) == 1
    assert "absent" in caplog.text


def test_a_camera_without_a_lamp_shows_nothing() -> None:
    NoLed().show(LedState.FAULT)
