"""The configuration: a strict TOML file, options before it, and no field that nobody explains."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import msgspec
import pytest

from prismstereo_device.control.settings import Settings
from prismstereo_device.program.configuration import Configuration
from prismstereo_device.program.options import read_options
from prismstereo_hw.errors import UsageError

WHOLE = """
sensor = "twin:oak-1"
link = "tcp:127.0.0.1:0"
filters = "robot"
serial = "PS-0007"
still_encoding = "jpeg"
[settings]
matcher = "bm"
exposure_us = 8000.0
region = [0, 0, 320, 180]
bound = 2
"""


def test_a_file_says_what_runs() -> None:
    read = Configuration.parse(WHOLE, "device.toml")
    assert (read.sensor, read.link, read.filters, read.serial) == ("twin:oak-1", "tcp:127.0.0.1:0", "robot", "PS-0007")
    assert read.settings == Settings(matcher="bm", exposure_us=8000.0, region=(0, 0, 320, 180), bound=2)
    assert Configuration.parse("", "empty") == Configuration()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sensr = 'twin:oak-1'", "unknown field `sensr`"),
        ("baud = '921600'", r"Expected `int \| null`, got `str` - at `\$\.baud`"),
        ("baud = 3", r">= 1200 - at `\$\.baud`"),
        ("preview_hz = 0", r"> 0\.0 - at `\$\.preview_hz`"),
        ("still_encoding = 'gif'", r"Invalid enum value 'gif' - at `\$\.still_encoding`"),
        ("[settings]\nbound = 'fine'", r"at `\$\.settings\.bound`"),
        ("[settings]\nregion = [1, 2]", r"at `\$\.settings\.region`"),
        ("[settings]\nfocus = 3", "unknown field `focus`"),
        ("sensor = ", "device.toml is not TOML"),
        ('serial = "a\\u0001b"', r"at `\$\.serial`"),
    ],
)
def test_a_wrong_field_is_named_with_its_file(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        Configuration.parse(text, "device.toml")
    assert "device.toml" in str(caught.value)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes(b"name = '\xe9'")
    (tmp_path / "large.toml").write_bytes(b"#" * 70_000)
    for name, words in (("missing", "no configuration"), ("latin.toml", "UTF-8"), ("large.toml", "has 70000 bytes")):
        with pytest.raises(UsageError, match=words):
            Configuration.read(tmp_path / name)


def test_options_go_before_the_file_and_leave_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "device.toml"
    path.write_text(WHOLE)
    asked = read_options(["--config", str(path), "--link", "pty", "--matcher", "tiles", "--rate", "12", "--lossless"])
    found = asked.configuration
    assert (found.link, found.sensor, found.lossless, found.filters) == ("pty", "twin:oak-1", True, "robot")
    assert found.settings == Settings(
        matcher="tiles", rate_hz=12.0, exposure_us=8000.0, region=(0, 0, 320, 180), bound=2
    )
    assert not asked.check


def test_an_option_that_cannot_be_is_refused_like_a_field() -> None:
    with pytest.raises(UsageError, match=r"the command line: .*baud"):
        read_options(["--sensor", "twin:oak-1", "--baud", "3"])


def test_the_state_folder_is_the_service_managers_where_none_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert Configuration().state_folder is None
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/prismstereo:/var/lib/other")
    assert Configuration().state_folder == Path("/var/lib/prismstereo")
    assert Configuration(state="here").state_folder == Path("here")


def test_what_is_shown_can_be_read_again_and_holds_no_password() -> None:
    read = Configuration.parse(WHOLE, "device.toml")
    assert msgspec.convert(read.shown(), Configuration) == read
    shown = Configuration(sensor="url:rtsp://eve:secret@camera.local/stream").shown()
    assert shown["sensor"] == "url:rtsp://camera.local/stream"


def test_every_field_is_explained() -> None:
    source = inspect.getsource(Configuration)
    for name in Configuration.__struct_fields__:
        assert re.search(rf"^    {name}: [^\n]+\n    \"\"\"[A-Z]", source, re.MULTILINE), name
