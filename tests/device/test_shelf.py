"""Objects by number: what a host may read and write, and what it can never talk the camera into."""

from __future__ import annotations

import hashlib
import pickle
import struct
import threading
from dataclasses import replace
from pathlib import Path

import google_crc32c
import msgspec
import numpy as np
import pytest

from device.power_cut import ModelDisk
from prismstereo_calibration import flash, schema
from prismstereo_calibration.model import Calibration
from prismstereo_device.objects import Held, ObjectNumber, Objects, Progress, WriteStatus
from prismstereo_device.state import CalibrationSlots, MemoryDisk, RealDisk, Shelf, Staging, accepts
from prismstereo_device.state.disk import Disk
from prismstereo_device.wire import LIMITS
from prismstereo_hw.rig import Rig

CALIBRATION, FACTORY, UPDATE = ObjectNumber.CALIBRATION, ObjectNumber.FACTORY_CALIBRATION, ObjectNumber.UPDATE


def shelf_on(disk: Disk, **options: object) -> Shelf:
    return Shelf(CalibrationSlots(disk), Staging(disk), **{"accepts": lambda content: None, **options})


def write(shelf: Objects, content: bytes, obj: int = CALIBRATION) -> Progress:
    sha256 = hashlib.sha256(content).digest()
    progress = shelf.begin(obj, len(content), sha256)
    if progress.status is not WriteStatus.OK:
        return progress
    for offset in range(0, len(content), 3000):
        assert shelf.write(obj, offset, content[offset : offset + 3000]).status is WriteStatus.OK
    return shelf.commit(obj, len(content), sha256)


@pytest.fixture(scope="module")
def calibration(oak: Rig) -> Calibration:
    return Calibration.nominal(oak)


@pytest.fixture
def camera(calibration: Calibration) -> tuple[Shelf, list[bytes]]:
    """A shelf with a calibration on it, and what it tells of new ones."""
    told: list[bytes] = []
    disk = MemoryDisk()
    CalibrationSlots(disk).write(flash.pack(calibration))
    check = accepts((calibration.frame_width, calibration.frame_height))
    shelf = shelf_on(disk, accepts=check, changed=told.append)
    return shelf, told


def test_a_written_calibration_is_active_told_and_still_there_after_a_restart(tmp_path: Path) -> None:
    told: list[bytes] = []
    shelf = shelf_on(RealDisk(tmp_path), changed=told.append)
    assert shelf.read(CALIBRATION) is None
    for content in (b"one", b"two"):
        assert write(shelf, content).status is WriteStatus.OK
    assert told == [b"one", b"two"]
    for found in (shelf, shelf_on(RealDisk(tmp_path))):
        assert found.calibration == b"two"
        assert found.read(CALIBRATION) == Held(int.from_bytes(flash.digest(b"two")[:4], "little"), b"two")
        assert found.read(FACTORY) == Held(int.from_bytes(flash.digest(b"one")[:4], "little"), b"one")
        assert found.persistent


def test_the_factory_calibration_can_be_restored_but_not_written() -> None:
    told: list[bytes] = []
    shelf = shelf_on(MemoryDisk(), changed=told.append)
    assert shelf.restore_factory().status is WriteStatus.REFUSED
    write(shelf, b"one")
    write(shelf, b"two")
    assert write(shelf, b"three", FACTORY).status is WriteStatus.NO_SUCH_OBJECT
    assert shelf.restore_factory().status is WriteStatus.OK
    assert (shelf.calibration, told) == (b"one", [b"one", b"two", b"one"])


def test_without_a_state_folder_a_calibration_is_kept_in_memory_and_said_to_be() -> None:
    shelf = shelf_on(MemoryDisk())
    assert write(shelf, b"one").status is WriteStatus.OK
    assert (shelf.calibration, shelf.persistent) == (b"one", False)


def test_a_disk_that_fails_while_a_calibration_is_committed_leaves_the_old_one() -> None:
    disk = ModelDisk()
    told: list[bytes] = []
    shelf = shelf_on(disk, changed=told.append)
    write(shelf, b"one")
    sha256 = hashlib.sha256(b"two").digest()
    shelf.begin(CALIBRATION, 3, sha256)
    shelf.write(CALIBRATION, 0, b"two")
    disk.fail_at, disk.fail_for_ever = disk.calls + 3, True
    failed = shelf.commit(CALIBRATION, 3, sha256)
    assert (failed.status, shelf.calibration, told) == (WriteStatus.NO_ROOM, b"one", [b"one"])
    disk.fail_at = None
    assert shelf.commit(CALIBRATION, 3, sha256).status is WriteStatus.OK
    assert told == [b"one", b"two"]


@pytest.mark.parametrize("obj", [0, 2, 3, 5, 6, 7, 8, 9, 255])
def test_what_may_not_be_written_is_refused(obj: int) -> None:
    shelf = shelf_on(MemoryDisk(), made={ObjectNumber.LOG: lambda: b"log"})
    assert shelf.begin(obj, 3, bytes(32)).status is WriteStatus.NO_SUCH_OBJECT
    assert shelf.write(obj, 0, b"x").status is WriteStatus.NO_SUCH_OBJECT
    assert shelf.commit(obj, 3, bytes(32)).status is WriteStatus.NO_SUCH_OBJECT


@pytest.mark.parametrize("size", [0, LIMITS.calibration + 1, 2**32 - 1])
def test_a_calibration_of_no_possible_size_is_refused_before_a_byte_is_taken(size: int) -> None:
    disk = MemoryDisk()
    assert shelf_on(disk).begin(CALIBRATION, size, bytes(32)).status is WriteStatus.TOO_LARGE
    assert disk.names("staging") == []


def test_a_camera_without_an_update_key_or_a_state_folder_takes_no_updates(tmp_path: Path) -> None:
    class Taker:
        def take(self, name: str) -> str | None:
            return None

    assert "no update key" in shelf_on(RealDisk(tmp_path)).begin(UPDATE, 9, bytes(32)).why
    assert "no state folder" in shelf_on(MemoryDisk(), updates=Taker()).begin(UPDATE, 9, bytes(32)).why
    shelf = shelf_on(RealDisk(tmp_path), updates=Taker())
    assert shelf.begin(UPDATE, LIMITS.object + 1, bytes(32)).status is WriteStatus.TOO_LARGE
    assert write(shelf, bytes(300_000), UPDATE).status is WriteStatus.OK
    assert shelf.read(UPDATE) is None


def test_a_still_is_shown_until_the_next_one_and_findings_are_made_when_asked_for() -> None:
    findings = iter((b"first", b"second"))
    shelf = shelf_on(MemoryDisk(), made={ObjectNumber.SELF_TEST: lambda: next(findings)})
    assert shelf.read(ObjectNumber.STILL) is None
    for version in (4, 5):
        shelf.put(ObjectNumber.STILL, Held(version, b"picture"))
        assert shelf.read(ObjectNumber.STILL) == Held(version, b"picture")
    contents = [shelf.read(ObjectNumber.SELF_TEST) for _ in range(2)]
    assert [held and held.content for held in contents] == [b"first", b"second"]
    assert shelf.read(77) is None


def test_a_log_that_grows_while_it_is_read_is_read_as_it_was_at_the_start() -> None:
    lines: list[bytes] = []
    times_s = [0.0, 0.9, 1.8, 2.7, 3.8]
    clock = iter(times_s)

    def log() -> bytes:
        lines.append(b"line\n")
        return b"".join(lines)

    shelf = shelf_on(MemoryDisk(), made={ObjectNumber.LOG: log}, clock_s=lambda: next(clock))
    seen = [shelf.read(ObjectNumber.LOG) for _ in times_s]
    assert [held and len(held.content) for held in seen] == [5, 5, 5, 5, 10]
    assert len({held and held.version for held in seen}) == 2


def test_reading_does_not_wait_for_a_commit() -> None:
    checking, go_on = threading.Event(), threading.Event()

    def slow(content: bytes) -> str | None:
        checking.set()
        assert go_on.wait(10)
        return "slow, and refused"

    shelf = shelf_on(MemoryDisk(), accepts=slow)
    shelf.put(ObjectNumber.STILL, Held(1, b"picture"))
    answers: list[Progress] = []
    writer = threading.Thread(target=lambda: answers.append(write(shelf, b"one")))
    writer.start()
    assert checking.wait(10)
    held = shelf.read(ObjectNumber.STILL)
    go_on.set()
    writer.join(10)
    assert held == Held(1, b"picture")
    assert [(answer.status, answer.why) for answer in answers] == [(WriteStatus.REFUSED, "slow, and refused")]


def enveloped(text: bytes) -> bytes:
    """Put any text into the flash's envelope, with a CRC that is right."""
    body = struct.pack("<4sHI", b"PSC\n", 1, len(text)) + text
    return body + struct.pack("<I", google_crc32c.value(body))


def with_field(text: bytes, **fields: object) -> bytes:
    content = {key: value for key, value in msgspec.json.decode(text).items() if key != "sha256"}
    return msgspec.json.encode({**content, **fields})


def without(text: bytes, *keys: str) -> bytes:
    content = msgspec.json.decode(text)
    return msgspec.json.encode({key: value for key, value in content.items() if key not in ("sha256", *keys)})


def number_in(text: bytes, key: bytes, word: bytes) -> bytes:
    """Put a word of its own where a number stands."""
    before, after = with_field(text, rms_px=0.5).split(b'"' + key + b'":', 1)
    end = next(at for at, byte in enumerate(after) if byte in b",}]")
    return before + b'"' + key + b'":' + word + after[end:]


BAD_TEXTS = {
    "NaN": (lambda text: number_in(text, b"rms_px", b"NaN"), "rms_px"),
    "infinity": (lambda text: number_in(text, b"rms_px", b"Infinity"), "rms_px"),
    "minus infinity": (lambda text: number_in(text, b"rms_px", b"-Infinity"), "rms_px"),
    "1e308": (lambda text: number_in(text, b"near_mm", b"1e308"), "near_mm"),
    "1e999": (lambda text: number_in(text, b"near_mm", b"1e999"), "near_mm|out of range"),
    "a wrong type": (lambda text: with_field(text, labels="many"), "labels"),
    "a number as text": (lambda text: with_field(text, near_mm="400"), "near_mm"),
    "a missing key": (lambda text: without(text, "R_right_from_left"), "R_right_from_left"),
    "an unknown key": (lambda text: with_field(text, shell="rm"), "shell"),
    "a duplicate key": (lambda text: with_field(text)[:-1] + b',"labels":64}', "labels is given twice"),
    "a negative focal length": (
        lambda text: with_field(text, left_lens={**msgspec.json.decode(text)["left_lens"], "fx_px": -1.0}),
        "left_lens",
    ),
    "a rotation that is none": (
        lambda text: with_field(text, R_right_from_left=[[1, 0, 0], [0, 1, 0], [0, 1, 0]]),
        "R_right_from_left",
    ),
    "a rotation turned over": (
        lambda text: with_field(
            text, R_right_from_left=np.array(msgspec.json.decode(text)["R_right_from_left"]).T.tolist()
        ),
        "R_right_from_left",
    ),
    "another schema": (lambda text: with_field(text, schema="prismstereo-calibration/9"), "schema"),
    "an edit under a sha256": (lambda text: text.replace(b'"views_used":0', b'"views_used":7'), "sha256"),
    "a byte order mark": (lambda text: b"\xef\xbb\xbf" + text, "byte order mark"),
    "a pickle": (lambda text: pickle.dumps({"text": text}), "JSON"),
    "YAML tags": (lambda text: b"!!python/object/apply:os.system ['true']", "JSON"),
    "depth": (lambda text: b"[" * 100_000, "JSON|calibration"),
    "UTF-16": (lambda text: text.decode().encode("utf-16"), "JSON"),
    "nothing": (lambda text: b"", "JSON"),
    "null": (lambda text: b"null", "calibration"),
}


@pytest.mark.parametrize("fault", BAD_TEXTS)
def test_a_calibration_that_is_none_is_refused_by_its_field_and_the_old_one_stays(
    fault: str, camera: tuple[Shelf, list[bytes]], calibration: Calibration
) -> None:
    spoil, field = BAD_TEXTS[fault]
    shelf, told = camera
    text = schema.encode(calibration)
    spoiled = spoil(text)
    assert spoiled != text
    refused = write(shelf, enveloped(spoiled))
    assert refused.status is WriteStatus.REFUSED
    assert any(part in refused.why for part in field.split("|")), refused.why
    assert (shelf.calibration, told) == (flash.pack(calibration), [])


def test_a_calibration_of_this_camera_is_accepted(camera: tuple[Shelf, list[bytes]], calibration: Calibration) -> None:
    shelf, told = camera
    other = flash.pack(replace(calibration, rms_px=0.25))
    assert write(shelf, other) == Progress(WriteStatus.OK, len(other))
    assert (shelf.calibration, told) == (other, [other])


def test_flash_bytes_that_are_cut_flipped_or_of_another_kind_are_refused(
    camera: tuple[Shelf, list[bytes]], calibration: Calibration
) -> None:
    shelf, _ = camera
    whole = flash.pack(calibration)
    flipped = bytearray(whole)
    flipped[500] ^= 4
    for wrong, why in (
        (whole[:-9], "cut"),
        (bytes(flipped), "damaged"),
        (whole + b"\0", "cut"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "no calibration"),
        (bytes(LIMITS.calibration), "no calibration"),
    ):
        refused = write(shelf, wrong)
        assert (refused.status, why in refused.why) == (WriteStatus.REFUSED, True), refused.why
    assert shelf.calibration == whole


def test_a_calibration_of_another_frame_size_is_refused_by_its_fields(
    camera: tuple[Shelf, list[bytes]], calibration: Calibration, small: Rig
) -> None:
    shelf, _ = camera
    refused = write(shelf, flash.pack(Calibration.nominal(small)))
    size = f"{calibration.frame_width}x{calibration.frame_height}"
    assert refused.status is WriteStatus.REFUSED
    assert f"frames of 320x180, but this camera gives {size}" in refused.why
    assert "frame_width_px" in refused.why
