"""The self-test names what is wrong and what to do about it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec
import pytest

from device.small_camera import AtOnce, DrawnSensor, SmallCamera
from prismstereo_device.control.self_test import (
    Facts,
    SelfTest,
    Surroundings,
    Verdict,
    available_bytes,
    findings,
    storage_error,
)
from prismstereo_device.objects import Held
from prismstereo_device.state import MemoryDisk, RealDisk

WELL = Facts(
    frames=300,
    away="",
    losses=0,
    rate_hz=29.9,
    wished_rate_hz=30.0,
    backward_stamps=0,
    unfit="",
    frame_size=(1280, 720),
    calibrated_size=(1280, 720),
    match_ms=12.0,
    temperature_c=50.0,
)
AROUND = Surroundings(factory_copy=True, persistent=True, storage_error="", memory_bytes=1 << 30)


def test_a_camera_in_order_has_nothing_to_mend() -> None:
    found = findings(WELL, AROUND)
    assert {finding.verdict for finding in found} == {Verdict.OK}
    assert [finding.name for finding in found] == [
        "camera", "rate", "clock", "frames", "matcher", "temperature", "calibration", "storage", "memory"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "name", "verdict"),
    [
        ({"away": "the cable was pulled out"}, "camera", Verdict.FAIL),
        ({"losses": 2}, "camera", Verdict.WARN),
        ({"frames": 0, "rate_hz": None}, "camera", Verdict.FAIL),
        ({"rate_hz": 20.0}, "rate", Verdict.WARN),
        ({"backward_stamps": 1}, "clock", Verdict.FAIL),
        ({"frame_size": (640, 480)}, "frames", Verdict.FAIL),
        ({"unfit": "frame 3 was taken at lens position 141"}, "frames", Verdict.FAIL),
        ({"match_ms": 40.0}, "matcher", Verdict.WARN),
        ({"temperature_c": 80.0}, "temperature", Verdict.WARN),
        ({"temperature_c": 90.0}, "temperature", Verdict.FAIL),
        ({"factory_copy": False}, "calibration", Verdict.WARN),
        ({"storage_error": "a file could not be written: No space left on device"}, "storage", Verdict.FAIL),
        ({"persistent": False}, "storage", Verdict.WARN),
        ({"memory_bytes": 100 << 20}, "memory", Verdict.WARN),
        ({"memory_bytes": 10 << 20}, "memory", Verdict.FAIL),
    ],
)
def test_each_fault_is_found_under_its_name_with_its_mend(
    change: dict[str, object], name: str, verdict: Verdict
) -> None:
    inner = {key: value for key, value in change.items() if hasattr(WELL, key)}
    outer = {key: value for key, value in change.items() if hasattr(AROUND, key)}
    found = {f.name: f for f in findings(dataclasses.replace(WELL, **inner), dataclasses.replace(AROUND, **outer))}
    assert found[name].verdict is verdict
    assert found[name].said
    assert found[name].mend


def test_a_running_camera_tells_its_own_facts() -> None:
    camera = SmallCamera(DrawnSensor())
    for _ in range(6):
        camera.source.read()
    camera.controls.order_self_test()
    camera.source.read()
    (facts,) = camera.facts
    assert (facts.frames, facts.frame_size, facts.calibrated_size) == (6, (320, 180), (320, 180))
    assert (facts.backward_stamps, facts.losses, facts.away, facts.unfit) == (0, 0, "", "")
    assert facts.match_ms is not None
    assert facts.rate_hz is not None


def test_the_report_is_json_and_is_given_to_whoever_keeps_it() -> None:
    kept: list[Held] = []
    done: list[bool] = []
    test = SelfTest(
        AtOnce(), MemoryDisk(), factory_copy=lambda: False, keep=kept.append, done=lambda: done.append(True)
    )
    test.run(dataclasses.replace(WELL, temperature_c=90.0))
    told = msgspec.json.decode(kept[0].content)
    assert told["ok"] is False
    assert {
        "name": "temperature",
        "verdict": "fail",
        "said": "90 degrees C",
        "mend": "give it air, or a lower rate",
    } in told["findings"]
    assert done == [True]
    assert kept[0].version > 0


def test_storage_is_tried_and_left_clean(tmp_path: Path) -> None:
    disk = RealDisk(tmp_path / "state")
    assert storage_error(disk) == ""
    assert disk.names() == []

    class Broken(MemoryDisk):
        def read(self, name: str) -> bytes:
            return super().read(name)[:-1] + b"?"

    class Full(MemoryDisk):
        def write(self, name: str, data: bytes) -> None:
            raise OSError(28, "No space left on device")

    assert storage_error(Broken()) == "a file reads back as other bytes than were written"
    assert storage_error(Full()) == "a file could not be written: No space left on device"


def test_available_memory_is_read_from_the_system(tmp_path: Path) -> None:
    said = tmp_path / "meminfo"
    said.write_text("MemTotal:  4000000 kB\nMemAvailable:   123456 kB\n")
    assert available_bytes(said) == 123_456 * 1024
    said.write_text("MemTotal:  4000000 kB\n")
    assert available_bytes(said) is None
    assert available_bytes(tmp_path / "missing") is None
