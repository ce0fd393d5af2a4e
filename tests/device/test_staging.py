"""Uploads go on where they broke off, and nothing that is not whole ever counts."""

from __future__ import annotations

import hashlib
import random
from pathlib import Path

import pytest

from device.power_cut import ModelDisk, PowerCut
from prismstereo_device.objects import WriteStatus
from prismstereo_device.state import MemoryDisk, RealDisk, Staging, StorageError
from prismstereo_device.state.disk import Disk

OBJ = 4
PACKET = 1003  # bytes of one part: never in step with the blocks


def made(size: int, seed: int = 0) -> tuple[bytes, bytes]:
    content = random.Random(seed).randbytes(size)
    return content, hashlib.sha256(content).digest()


class Owner:
    """Takes what is whole, and remembers it."""

    def __init__(self, disk: Disk, why: str | None = None) -> None:
        self.disk, self.why, self.taken = disk, why, list[bytes]()

    def __call__(self, name: str) -> str | None:
        self.taken.append(self.disk.read(name))
        return self.why


def send(staging: Staging, content: bytes, sha256: bytes, until: int | None = None) -> int:
    """Begin or go on, and send packets until so many bytes are held; return how many were held at the start."""
    begun = staging.begin(OBJ, len(content), sha256)
    assert begun.status is WriteStatus.OK
    held = begun.held
    while held < (len(content) if until is None else until):
        progress = staging.write(OBJ, held, content[held : held + PACKET])
        assert progress.status is WriteStatus.OK
        held = progress.held
    return begun.held


def test_what_was_sent_in_parts_is_handed_over_whole(tmp_path: Path) -> None:
    for disk in (RealDisk(tmp_path), MemoryDisk()):
        for size in (1, 16_384, 16_385, 100_000):
            content, sha256 = made(size)
            staging, owner = Staging(disk), Owner(disk)
            send(staging, content, sha256)
            assert staging.commit(OBJ, size, sha256, owner).status is WriteStatus.OK
            assert owner.taken == [content]
            assert disk.names("staging") == []


def test_a_gap_is_refused_and_what_is_held_is_skipped() -> None:
    content, sha256 = made(50_000)
    staging = Staging(MemoryDisk())
    send(staging, content, sha256, until=20_000)
    held = staging.begin(OBJ, 50_000, sha256).held
    gap = staging.write(OBJ, held + 1, content[held + 1 : held + 100])
    assert (gap.status, gap.held) == (WriteStatus.GAP, held)
    assert staging.write(OBJ, held - 500, content[held - 500 : held]).held == held
    assert staging.write(OBJ, held - 500, content[held - 500 : held + 500]).held == held + 500
    assert staging.write(OBJ, 0, b"").held == held + 500
    owner = Owner(MemoryDisk())
    unfinished = staging.commit(OBJ, 50_000, sha256, owner)
    assert (unfinished.status, unfinished.held, owner.taken) == (WriteStatus.GAP, held + 500, [])


def test_bytes_beyond_the_announced_size_are_refused() -> None:
    content, sha256 = made(1000)
    staging = Staging(MemoryDisk())
    staging.begin(OBJ, 999, sha256)
    assert staging.write(OBJ, 0, content).status is WriteStatus.TOO_LARGE


def test_what_was_not_begun_cannot_be_written_or_committed() -> None:
    staging = Staging(MemoryDisk())
    content, sha256 = made(1000)
    assert staging.write(OBJ, 0, content).status is WriteStatus.NOT_BEGUN
    staging.begin(OBJ, 1000, sha256)
    owner = Owner(MemoryDisk())
    assert staging.commit(OBJ, 1000, bytes(32), owner).status is WriteStatus.NOT_BEGUN
    assert staging.commit(OBJ, 999, sha256, owner).status is WriteStatus.NOT_BEGUN


def test_another_upload_of_the_same_object_takes_its_place(tmp_path: Path) -> None:
    disk = RealDisk(tmp_path)
    staging = Staging(disk)
    first, second = made(60_000, seed=1), made(40_000, seed=2)
    send(staging, *first, until=50_000)
    assert send(staging, *second) == 0
    owner = Owner(disk)
    assert staging.commit(OBJ, 60_000, first[1], owner).status is WriteStatus.NOT_BEGUN
    assert staging.commit(OBJ, 40_000, second[1], owner).status is WriteStatus.OK
    assert owner.taken == [second[0]]


def test_bytes_that_do_not_have_the_announced_sha256_are_dropped() -> None:
    disk = MemoryDisk()
    content, _ = made(30_000)
    staging, owner = Staging(disk), Owner(disk)
    send(staging, content, bytes(32))
    assert staging.commit(OBJ, 30_000, bytes(32), owner).status is WriteStatus.MISMATCH
    assert (owner.taken, disk.names("staging")) == ([], [])


def test_what_the_owner_refuses_is_dropped_and_the_sentence_comes_back() -> None:
    disk = MemoryDisk()
    content, sha256 = made(30_000)
    staging, owner = Staging(disk), Owner(disk, why="focal_px is wrong")
    send(staging, content, sha256)
    refused = staging.commit(OBJ, 30_000, sha256, owner)
    assert (refused.status, refused.why, disk.names("staging")) == (WriteStatus.REFUSED, "focal_px is wrong", [])


def test_a_commit_that_is_repeated_is_done_once() -> None:
    disk = MemoryDisk()
    content, sha256 = made(3000)
    staging, owner = Staging(disk), Owner(disk)
    send(staging, content, sha256)
    for _ in range(3):
        assert staging.commit(OBJ, 3000, sha256, owner).status is WriteStatus.OK
    assert len(owner.taken) == 1


def test_a_commit_that_the_disk_failed_can_be_repeated() -> None:
    disk = MemoryDisk()
    content, sha256 = made(3000)
    staging, owner = Staging(disk), Owner(disk)

    def broken(name: str) -> str | None:
        raise StorageError(f"no room for {name}")

    send(staging, content, sha256)
    assert staging.commit(OBJ, 3000, sha256, broken).status is WriteStatus.NO_ROOM
    assert staging.commit(OBJ, 3000, sha256, owner).status is WriteStatus.OK
    assert owner.taken == [content]


def test_a_disk_without_room_is_said_before_a_byte_is_taken() -> None:
    disk = MemoryDisk(room=10_000)
    refused = Staging(disk).begin(OBJ, 10_001, bytes(32))
    assert refused.status is WriteStatus.NO_ROOM
    assert "10001 bytes are to be stored, 10000 are free" in refused.why
    assert disk.names("staging") == []


def test_an_unfinished_upload_of_another_object_makes_room() -> None:
    disk = MemoryDisk(room=10_000)
    staging = Staging(disk)
    staging.begin(1, 8000, bytes(32))
    staging.write(1, 0, bytes(8000))
    assert staging.begin(OBJ, 9000, bytes(32)).status is WriteStatus.OK
    assert staging.write(1, 8000, b"").status is WriteStatus.NOT_BEGUN


def test_an_upload_goes_on_after_a_restart_but_for_its_last_block(tmp_path: Path) -> None:
    content, sha256 = made(100_000)
    send(Staging(RealDisk(tmp_path)), content, sha256, until=70_000)
    restarted = Staging(RealDisk(tmp_path))
    assert send(restarted, content, sha256) == 65_536
    owner = Owner(RealDisk(tmp_path))
    assert restarted.commit(OBJ, 100_000, sha256, owner).status is WriteStatus.OK
    assert owner.taken == [content]


@pytest.mark.parametrize("damage", ["part", "marks", "head", "short"])
def test_damage_on_the_disk_is_noticed_and_sent_again(damage: str, tmp_path: Path) -> None:
    content, sha256 = made(100_000)
    disk = RealDisk(tmp_path)
    send(Staging(disk), content, sha256)
    if damage == "short":
        disk.write(f"staging/{OBJ}.part", content[:40_000])
    else:
        name, at = {"part": ("part", 40_000), "marks": ("marks", 55), "head": ("marks", 6)}[damage]
        disk.write_at(f"staging/{OBJ}.{name}", at, b"\xff\x00\xff")
    restarted = Staging(disk)
    assert send(restarted, content, sha256) == (0 if damage == "head" else 32_768)
    owner = Owner(disk)
    assert restarted.commit(OBJ, 100_000, sha256, owner).status is WriteStatus.OK
    assert owner.taken == [content]


def test_what_belongs_to_no_upload_is_cleared_away(tmp_path: Path) -> None:
    disk = RealDisk(tmp_path)
    for name in ("staging/3.part", "staging/7.marks", "staging/leftover"):
        disk.write(name, b"x")
    Staging(disk)
    assert disk.names("staging") == []


def test_a_megabyte_cut_ten_times_comes_through_by_its_offsets() -> None:
    content, sha256 = made(1_000_000)
    rng = random.Random(11)
    disk, sent = ModelDisk(), 0
    staging, owner = Staging(disk), Owner(disk)
    for cut in sorted(rng.sample(range(len(content)), 10)):
        held = send(staging, content, sha256, until=cut)
        sent += max(0, cut - held)
        assert owner.taken == []
        match rng.choice(("session", "process", "power")):
            case "process":
                disk = disk.after_a_kill()
            case "power":
                disk = disk.after_a_cut(rng)
            case _:
                continue
        staging, owner = Staging(disk), Owner(disk)
    sent += len(content) - send(staging, content, sha256)
    assert staging.commit(OBJ, len(content), sha256, owner).status is WriteStatus.OK
    assert [hashlib.sha256(taken).digest() for taken in owner.taken] == [sha256]
    assert sent < 6 * len(content)  # a power cut may take everything that was not synced, a restart 16 KiB


def cut_uploads(runs: int, seed: int) -> int:
    """Cut the power at any disk call of an upload and its commit; return how many uploads came through at last."""
    rng = random.Random(seed)
    finished = 0
    for run in range(runs):
        content, sha256 = made(40_000, seed=run)
        disk, done = ModelDisk(), False
        while not done:
            disk.cut_at = disk.calls + rng.randrange(1, 120)
            owner = Owner(disk)
            try:
                staging = Staging(disk)
                send(staging, content, sha256)
                done = staging.commit(OBJ, len(content), sha256, owner).status is WriteStatus.OK
            except PowerCut:
                pass
            assert owner.taken in ([], [content])
            if not done:
                disk = disk.after_a_cut(rng)
        finished += 1
    return finished


def test_a_power_cut_at_any_call_never_lets_half_an_object_through() -> None:
    assert cut_uploads(40, seed=1) == 40


@pytest.mark.soak
def test_thousands_of_power_cuts_never_let_half_an_object_through() -> None:
    print(
        f"\nuploads of 40 kB with the power cut at random calls: {cut_uploads(5000, seed=2)} of 5000 came through whole"
    )


@pytest.mark.parametrize("for_ever", [False, True])
def test_a_disk_call_that_fails_is_answered_and_the_upload_can_go_on(for_ever: bool) -> None:
    content, sha256 = made(40_000)
    for at in range(60):
        disk = ModelDisk()
        disk.fail_at, disk.fail_for_ever = at, for_ever
        staging, owner = Staging(disk), Owner(disk)
        for _ in range(2):
            progress = staging.begin(OBJ, len(content), sha256)
            while progress.status is WriteStatus.OK and progress.held < len(content):
                progress = staging.write(OBJ, progress.held, content[progress.held : progress.held + PACKET])
            assert progress.status in (WriteStatus.OK, WriteStatus.NO_ROOM)
            disk.fail_at = None
        assert staging.commit(OBJ, len(content), sha256, owner).status is WriteStatus.OK
        assert owner.taken == [content]
