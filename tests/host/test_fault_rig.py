from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from prismstereo.link_bench.damage import Damage
from prismstereo.link_bench.fault_line import FaultLine
from prismstereo.link_bench.fault_plan import FaultPlan, Faults, Spell
from prismstereo.link_bench.lane import Lane
from prismstereo_device.link import Link, LinkLost, open_link
from prismstereo_hw.errors import UsageError

STREAM = np.random.default_rng(7).integers(0, 256, 200_000).astype(np.uint8).tobytes()


def received(link: Link, size: int, timeout_s: float = 5.0) -> bytes:
    got, deadline = bytearray(), time.monotonic() + timeout_s
    while len(got) < size and time.monotonic() < deadline:
        got += link.read(0.1)
    return bytes(got)


def damaged(faults: Faults, data: bytes, piece: int, seed: int = 1) -> bytes:
    damage = Damage(faults, seed)
    return b"".join(damage.apply(data[at : at + piece], 0.0) for at in range(0, len(data), piece))


def test_a_plan_is_read_as_a_person_writes_it() -> None:
    plan = FaultPlan.parse("flips=1e-4, stall=0.2/1,down:drops=0.01,up:slow=11520")
    assert plan.up == Faults(flips=1e-4, stall=Spell(0.2, 1.0), slow=11520.0)
    assert plan.down == Faults(flips=1e-4, stall=Spell(0.2, 1.0), drops=0.01)
    assert plan.spells == (Spell(0.2, 1.0),)
    assert FaultPlan.parse("") == FaultPlan()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("flips", "write kind=value"),
        ("flops=1", "kinds are flips, bits"),
        ("flips=2", "a share from 0 to 1"),
        ("flips=nan", "a share from 0 to 1"),
        ("flips=often", "give a number"),
        ("stall=2/1", "0 < D < P"),
        ("stall=1", "D/P in seconds"),
        ("slow=1", "100 to 1e9"),
        ("sideways:flips=0.1", "up:kind=value"),
        ("up:replug=0.1/1", "not replug"),
    ],
)
def test_a_plan_that_cannot_be_meant_is_refused_by_name(text: str, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        FaultPlan.parse(text)


def test_a_spell_is_the_end_of_each_period() -> None:
    spell = Spell(0.25, 1.0)
    assert [spell.active(now_s) for now_s in (0.0, 0.7, 0.76, 0.99, 1.0, 1.8, 2.1)] == [0, 0, 1, 1, 0, 1, 0]


@pytest.mark.parametrize(
    ("faults", "share"), [(Faults(flips=0.01), 0.01), (Faults(bits=0.01), 1 - 0.99**8), (Faults(flips=1.0), 1.0)]
)
def test_as_many_bytes_are_changed_as_the_plan_says(faults: Faults, share: float) -> None:
    out = damaged(faults, STREAM, 1000)
    changed = np.frombuffer(out, np.uint8) != np.frombuffer(STREAM, np.uint8)
    assert changed.mean() == pytest.approx(share, rel=0.1)


@pytest.mark.parametrize(("faults", "growth"), [(Faults(drops=0.02), -0.02), (Faults(dups=0.02), 0.02)])
def test_as_many_bytes_are_lost_or_doubled_as_the_plan_says(faults: Faults, growth: float) -> None:
    assert len(damaged(faults, STREAM, 1000)) / len(STREAM) - 1 == pytest.approx(growth, rel=0.1)


def test_runs_of_bytes_are_lost_or_followed_by_garbage() -> None:
    assert len(damaged(Faults(chunkdrop=0.25), STREAM, 100)) == pytest.approx(150_000, rel=0.05)
    longer = damaged(Faults(garbage=0.5), STREAM, 1000)
    assert len(longer) - len(STREAM) == pytest.approx(100 * 200, rel=0.3)


def test_the_same_seed_does_the_same_damage_however_the_stream_is_chopped() -> None:
    faults = Faults(flips=1e-3, bits=1e-4, drops=1e-3, dups=1e-3)
    whole = damaged(faults, STREAM, len(STREAM))
    assert damaged(faults, STREAM, 777) == whole
    assert damaged(faults, STREAM, len(STREAM), seed=2) != whole


def test_a_dead_line_gives_nothing_and_a_wrong_speed_gives_noise() -> None:
    assert Damage(Faults(cut=Spell(0.5, 1.0)), 1).apply(STREAM, 0.6) == b""
    assert Damage(Faults(cut=Spell(0.5, 1.0)), 1).apply(STREAM, 1.1) == STREAM
    noise = Damage(Faults(baud=Spell(0.5, 1.0)), 1).apply(STREAM, 0.6)
    assert len(noise) == len(STREAM)
    assert (np.frombuffer(noise, np.uint8) == np.frombuffer(STREAM, np.uint8)).mean() < 0.01


def test_a_slow_lane_carries_its_bytes_per_second_and_holds_4_kib() -> None:
    lane, put, got = Lane(Faults(slow=10_000.0), 1), 0, 0
    for millisecond in range(1000):
        while room := lane.room:
            lane.put(bytes(room), millisecond / 1000)
            put += room
        out = lane.out(millisecond / 1000)
        lane.taken(len(out))
        got += len(out)
        assert put - got <= 4096
    assert got == pytest.approx(10_000, abs=200)


def test_a_lane_that_halts_keeps_its_bytes() -> None:
    lane = Lane(Faults(stall=Spell(0.5, 1.0)), 1)
    lane.put(b"early", 0.4)
    assert lane.out(0.6) == b""
    assert lane.out(1.01) == b"early"


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_a_clean_line_carries_both_ways_and_says_how_much(kind: str) -> None:
    with FaultLine(kind=kind) as line, open_link(line.device_port) as device, open_link(line.host_port) as host:
        for source, sink, size in ((device, host, 3000), (host, device, 2000)):
            assert source.write(STREAM[:size]) == size
            assert received(sink, size) == STREAM[:size]
        assert line.carried_bytes() == (2000, 3000)


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_a_pulled_plug_is_felt_at_once_and_the_new_port_has_the_old_name(kind: str) -> None:
    with FaultLine(kind=kind) as line, open_link(line.device_port) as device:
        for word in (b"first", b"second"):
            with open_link(line.host_port) as host:
                host.write(word)
                assert received(device, len(word)) == word
                line.replug()
                with pytest.raises(LinkLost):
                    received(host, 1)


def test_faults_can_be_changed_while_the_line_is_open() -> None:
    with FaultLine("cut=0.9/1000") as line, open_link(line.device_port) as device, open_link(line.host_port) as host:
        device.write(b"passes")
        assert received(host, 6) == b"passes"
        line.set_faults("down:drops=1")
        device.write(b"does not")
        host.write(b"does")
        assert received(device, 4) == b"does"
        assert received(host, 1, 0.1) == b""
        with pytest.raises(UsageError):
            line.set_faults("drops=2")


def test_a_paced_line_takes_the_time_of_a_uart() -> None:
    size = 9_000
    with (
        FaultLine(baud=921_600) as line,
        open_link(line.device_port) as device,
        open_link(line.host_port) as host,
    ):
        begin = time.monotonic()
        device.write(STREAM[:size])
        assert received(host, size) == STREAM[:size]
        took_s = time.monotonic() - begin
    assert 0.08 < took_s < 1.0  # 9000 bytes at 92160 a second


def test_nothing_of_a_line_is_left(tmp_path: Path) -> None:
    before = len(os.listdir("/dev/fd"))
    with FaultLine() as line:
        folder = Path(line.host_port).parent
        assert sorted(path.name for path in folder.iterdir()) == ["device", "host"]
    line.close()
    assert not folder.exists()
    assert len(os.listdir("/dev/fd")) == before
