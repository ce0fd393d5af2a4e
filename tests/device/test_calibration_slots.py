"""The calibration outlives whatever happens to the camera while it is written."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import google_crc32c
import pytest

from device.power_cut import ModelDisk, PowerCut
from prismstereo_device.state import CalibrationSlots, MemoryDisk, RealDisk, StorageError
from prismstereo_hw.errors import DataError, UsageError


def content(number: int) -> bytes:
    """Some nine kilobytes that tell by themselves whether they are whole."""
    body = number.to_bytes(4, "little") + random.Random(number).randbytes(9000)
    return body + google_crc32c.value(body).to_bytes(4, "little")


def number_of(flash: bytes | None) -> int | None:
    """The number of a whole content; None where there is none; a broken one fails the test."""
    if flash is None:
        return None
    assert google_crc32c.value(flash[:-4]) == int.from_bytes(flash[-4:], "little"), "a broken calibration is active"
    return int.from_bytes(flash[:4], "little")


def a_disk_with(*numbers: int) -> ModelDisk:
    disk = ModelDisk()
    slots = CalibrationSlots(disk)
    for number in numbers:
        slots.write(content(number))
    disk.calls = 0
    return disk


def calls_of_a_write(*before: int) -> int:
    disk = a_disk_with(*before)
    slots = CalibrationSlots(disk)
    start = disk.calls
    slots.write(content(99))
    return disk.calls - start


def test_what_is_written_is_active_and_is_found_again(tmp_path: Path) -> None:
    slots = CalibrationSlots(RealDisk(tmp_path))
    assert slots.active is None
    for number in (1, 2, 3):
        slots.write(content(number))
        assert number_of(slots.active) == number_of(CalibrationSlots(RealDisk(tmp_path)).active) == number


def test_the_first_calibration_stays_as_the_factory_copy_and_can_be_restored(tmp_path: Path) -> None:
    slots = CalibrationSlots(RealDisk(tmp_path))
    for number in (7, 8, 9):
        slots.write(content(number))
    assert number_of(slots.factory) == 7
    again = CalibrationSlots(RealDisk(tmp_path))
    assert number_of(again.restore()) == number_of(again.active) == number_of(again.factory) == 7


def test_there_is_nothing_to_restore_before_the_first_calibration() -> None:
    with pytest.raises(StorageError, match="no factory calibration"):
        CalibrationSlots(MemoryDisk()).restore()


def test_the_sequence_number_wraps() -> None:
    disk = a_disk_with(1)
    below_the_wrap = bytearray(disk.files["calibration.a"].now)
    below_the_wrap[4:8] = (2**32 - 2).to_bytes(4, "little")
    below_the_wrap[-4:] = google_crc32c.value(bytes(below_the_wrap[:-4])).to_bytes(4, "little")
    disk.files["calibration.a"].now[:] = below_the_wrap
    for number in range(2, 7):
        CalibrationSlots(disk).write(content(number))
        assert number_of(CalibrationSlots(disk).active) == number


@pytest.mark.parametrize("slot", ["calibration.a", "calibration.b"])
def test_any_flipped_bit_of_a_slot_makes_it_unread_and_the_other_one_is_taken(slot: str, tmp_path: Path) -> None:
    slots = CalibrationSlots(RealDisk(tmp_path))
    for number in (1, 2):
        slots.write(content(number))
    whole = (tmp_path / slot).read_bytes()
    rng = random.Random(5)
    for at in [
        *range(96),
        *(rng.randrange(len(whole) * 8) for _ in range(40)),
        *range(len(whole) * 8 - 32, len(whole) * 8),
    ]:
        flipped = bytearray(whole)
        flipped[at // 8] ^= 1 << at % 8
        (tmp_path / slot).write_bytes(flipped)
        assert number_of(CalibrationSlots(RealDisk(tmp_path)).active) == (2 if slot == "calibration.a" else 1)


def test_with_both_slots_broken_the_factory_copy_is_active_and_the_next_write_works() -> None:
    disk = a_disk_with(1, 2, 3)
    for slot in ("calibration.a", "calibration.b"):
        disk.files[slot].now[20] ^= 1
    slots = CalibrationSlots(disk)
    assert number_of(slots.active) == 1
    slots.write(content(4))
    assert number_of(CalibrationSlots(disk).active) == 4


def test_what_cannot_be_a_calibration_is_not_taken() -> None:
    slots = CalibrationSlots(MemoryDisk())
    for wrong in (b"", bytes(262_145)):
        with pytest.raises(DataError, match=f"{len(wrong)} bytes"):
            slots.write(wrong)


def test_a_disk_that_gives_back_other_bytes_is_noticed_and_the_old_calibration_stays(tmp_path: Path) -> None:
    class Forgetful(RealDisk):
        broken = False

        def read(self, name: str) -> bytes:
            data = super().read(name)
            return data[:-1] + b"\0" if self.broken and data else data

    disk = Forgetful(tmp_path)
    slots = CalibrationSlots(disk)
    slots.write(content(1))
    disk.broken = True
    with pytest.raises(StorageError, match="other bytes"):
        slots.write(content(2))
    assert number_of(slots.active) == number_of(CalibrationSlots(RealDisk(tmp_path)).active) == 1


@pytest.mark.parametrize("before", [(), (1,), (1, 2), (1, 2, 3)])
@pytest.mark.parametrize("for_ever", [False, True])
def test_a_disk_call_that_fails_leaves_the_old_calibration_wherever_it_is(
    before: tuple[int, ...], for_ever: bool
) -> None:
    for at in range(calls_of_a_write(*before)):
        disk = a_disk_with(*before)
        slots = CalibrationSlots(disk)
        old = number_of(slots.active)
        disk.fail_at, disk.fail_for_ever = disk.calls + at, for_ever
        with pytest.raises(StorageError, match="could not be stored"):
            slots.write(content(99))
        assert number_of(slots.active) == old
        disk.fail_at = None
        restarted = number_of(CalibrationSlots(disk.after_a_kill()).active)
        assert restarted == old or (for_ever and restarted == 99), (at, restarted)
        slots.write(content(100))
        assert number_of(slots.active) == number_of(CalibrationSlots(disk).active) == 100
        assert number_of(slots.factory) in ({1} if before else {100, restarted})


def cut_the_power(runs: int, seed: int) -> dict[str, int]:
    """Write calibrations, cut the power at a random disk call, start again; count what was found."""
    rng = random.Random(seed)
    found = {"old": 0, "new": 0, "unreadable": 0}
    disk = ModelDisk()
    newest: int | None = None
    for run in range(runs):
        if run % 25 == 0:  # a camera that never had one, and then one with a history of cuts
            disk, newest = ModelDisk(), None
        slots = CalibrationSlots(disk)
        disk.cut_at = disk.calls + rng.randrange(14)
        wanted = run + 1
        try:
            slots.write(content(wanted))
            newest = wanted
            wanted += runs
            slots.write(content(wanted))
            newest = wanted
        except PowerCut:
            pass
        disk = disk.after_a_cut(rng)
        restarted = CalibrationSlots(disk)
        active = number_of(restarted.active)
        assert active in (newest, wanted), f"run {run}: {active} is active, neither {newest} nor {wanted}"
        assert newest is None or restarted.factory is not None
        found["new" if active == wanted else "old"] += 1
        found["unreadable"] += active is None and newest is not None
        newest = active
    return found


def test_a_power_cut_leaves_the_old_calibration_or_the_new_one() -> None:
    found = cut_the_power(200, seed=7)
    assert found["unreadable"] == 0
    assert min(found["old"], found["new"]) > 20


@pytest.mark.soak
def test_ten_thousand_power_cuts_leave_no_camera_without_its_calibration() -> None:
    found = cut_the_power(10_000, seed=2010)
    print(f"\ncalibration store, 10000 modelled power cuts: {found}")
    assert found["unreadable"] == 0
    assert min(found["old"], found["new"]) > 1000


WRITER = """
import sys
from pathlib import Path
from device.test_calibration_slots import content
from prismstereo_device.state.calibration_slots import CalibrationSlots
from prismstereo_device.state.disk import RealDisk
slots = CalibrationSlots(RealDisk(Path(sys.argv[1])))
print("ready", flush=True)
number = int(sys.argv[2])
while True:
    number += 1
    slots.write(content(number))
    print(number, flush=True)
"""


def kill_writers(folder: Path, kills: int, seed: int) -> int:
    """Kill a process that writes one calibration after the other; return how many were written, having checked each restart."""
    rng, newest = random.Random(seed), 0
    for _ in range(kills):
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(folder), str(newest)],
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        ) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == b"ready\n"
            time.sleep(rng.uniform(0.005, 0.05))
            writer.send_signal(signal.SIGKILL)
            said = writer.stdout.read().split(b"\n")[:-1]
        acknowledged = int(said[-1]) if said else newest
        active = number_of(CalibrationSlots(RealDisk(folder)).active)
        assert active in (acknowledged or None, acknowledged + 1)
        newest = active or 0
    return newest


def test_a_killed_writer_leaves_the_old_calibration_or_the_new_one(tmp_path: Path) -> None:
    assert kill_writers(tmp_path, 2, seed=3) > 2


@pytest.mark.soak
def test_sixty_killed_writers_leave_the_old_calibration_or_the_new_one(tmp_path: Path) -> None:
    written = kill_writers(tmp_path, 60, seed=60)
    print(f"\n60 SIGKILLs while calibrations were written: {written} written, 0 unreadable, 0 went backwards")
    assert written > 60


def test_state_files_are_the_owners_alone_and_no_link_leads_out(tmp_path: Path) -> None:
    disk = RealDisk(tmp_path / "state")
    disk.write("calibration.a", b"x")
    assert (tmp_path / "state").stat().st_mode & 0o777 == 0o700
    assert (tmp_path / "state" / "calibration.a").stat().st_mode & 0o777 == 0o600
    outside = tmp_path / "outside"
    outside.write_bytes(b"mine")
    (tmp_path / "state" / "calibration.b").symlink_to(outside)
    (tmp_path / "state" / "staging").rmdir()
    (tmp_path / "state" / "staging").symlink_to(tmp_path)
    with pytest.raises(OSError, match="symbolic links"):
        disk.write("calibration.b", b"theirs")
    with pytest.raises(OSError, match=r"irectory|symbolic links"):
        disk.write("staging/outside", b"theirs")
    assert outside.read_bytes() == b"mine"


@pytest.mark.parametrize(
    "name", ["../x", "/x", "", ".x", "a/b", "staging/../x", "x\0", "X", "x" * 65, "staging/", "ｘ"]
)
def test_a_name_that_could_lead_out_of_the_folder_is_refused(name: str, tmp_path: Path) -> None:
    for disk in (RealDisk(tmp_path), MemoryDisk()):
        with pytest.raises(UsageError, match="no name of a state file"):
            disk.write(name, b"x")
    with pytest.raises(UsageError, match="no name of a state file"):
        RealDisk(tmp_path).rename("x", name)


def test_a_state_folder_that_cannot_be_made_is_said_by_name(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StorageError, match=r"state folder .*file.*cannot be used"):
        RealDisk(tmp_path / "file" / "state")
