from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from prismstereo_device.framing import Packet, encode
from prismstereo_device.link import Link, open_link
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pacing import Pacer, line_bytes_per_s, packet_bytes
from prismstereo_device.link.port_kind import PortKind, port_kind
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.link.serial_port import SerialPort, mtu_for_baud
from prismstereo_device.link.tcp import TcpClient, TcpServer


class StoppedClock:
    """Time that passes only while somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def read(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def drained(sink: Link, size: int) -> bytes:
    got = bytearray()
    while len(got) < size and (more := sink.read(1.0)):
        got += more
    return bytes(got)


def take_all(part: bytes, timeout_s: float) -> int:
    return len(part)


@pytest.mark.parametrize("baud", [115_200, 921_600, 3_000_000])
def test_a_paced_line_is_97_percent_full_and_two_packets_deep(baud: int) -> None:
    clock, size = StoppedClock(), packet_bytes(mtu_for_baud(baud))
    pacer = Pacer(line_bytes_per_s(baud), size, clock=clock.read, sleep=clock.sleep)
    for number in range(1, 1001):
        assert pacer.write(bytes(size), 1.0, take_all) == size
        on_the_line = clock.now_s * baud / 10
        assert number * size - on_the_line <= 2 * size
    assert 1000 * size / clock.now_s == pytest.approx(0.97 * baud / 10, rel=0.003)


def test_a_line_that_rested_does_not_make_up_for_it() -> None:
    clock = StoppedClock()
    pacer = Pacer(1000.0, 100, clock=clock.read, sleep=clock.sleep)
    clock.sleep(60.0)
    assert pacer.write(bytes(1000), 5.0, take_all) == 1000
    assert clock.now_s == pytest.approx(60.8, abs=0.01)  # but for the two packets that stand in line


def test_a_paced_write_comes_back_in_time_and_says_how_far_it_came() -> None:
    clock = StoppedClock()
    pacer = Pacer(1000.0, 100, clock=clock.read, sleep=clock.sleep)
    assert pacer.write(bytes(1000), 0.25, take_all) == 400
    assert clock.now_s == pytest.approx(0.25)


@pytest.mark.parametrize("bytes_per_s", [None, 1000.0])
def test_what_the_driver_still_holds_makes_the_writer_wait(bytes_per_s: float | None) -> None:
    clock = StoppedClock()
    held = [1000]

    def let_out(seconds: float) -> None:
        clock.sleep(seconds)
        held[0] = max(0, 1000 - int(clock.now_s * 500))  # half as fast as promised

    pacer = Pacer(bytes_per_s, 100, queued=lambda: held[0], clock=clock.read, sleep=let_out)
    assert pacer.write(bytes(100), 0.5, take_all) == 0
    assert pacer.write(bytes(100), 5.0, take_all) == 100
    assert clock.now_s == pytest.approx(1.8, abs=0.05)  # when 100 of the 1000 are left


@pytest.mark.parametrize("mtu", [128, 240, 512, 1024, 4096])
def test_the_longest_packet_is_known_beforehand(mtu: int) -> None:
    assert len(encode(Packet(2, b"\xff" * mtu), 0xFFFF_FFFF)) == packet_bytes(mtu)


def test_a_paced_pty_and_the_port_behind_it_take_the_time_of_a_uart() -> None:
    data = bytes(10_000)
    with PtyPort(baud=921_600) as device, SerialPort(device.name, 921_600) as host:
        assert (device.mtu, host.mtu) == (512, 512)
        for source, sink in ((device, host), (host, device)):
            begin = time.monotonic()
            assert source.write(data, 5.0) == len(data)
            took_s = time.monotonic() - begin
            assert drained(sink, len(data)) == data
            assert (len(data) - 2 * packet_bytes(512)) / 89_395 <= took_s < 2.0


def test_a_paced_loopback_takes_its_time() -> None:
    device, host = loopback(mtu=1024, bytes_per_s=50_000)
    begin = time.monotonic()
    assert device.write(bytes(7000)) == 7000
    assert 0.09 <= time.monotonic() - begin < 1.0
    assert len(host.read(0.1)) == 7000


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/dev/ttyUSB0", PortKind.UART),
        ("/dev/ttyAMA10", PortKind.UART),
        ("/dev/ttyS0", PortKind.UART),
        ("/dev/serial0", PortKind.UART),
        ("/dev/cu.usbserial-A50285BI", PortKind.UART),
        ("/dev/ttyACM0", PortKind.PACKETS),
        ("/dev/ttyGS0", PortKind.PACKETS),
        ("/dev/cu.usbmodem14101", PortKind.PACKETS),
        ("/dev/pts/3", PortKind.PTY),
        ("/dev/ttys003", PortKind.PTY),
        ("COM3", PortKind.UNKNOWN),
        ("/dev/null", PortKind.UNKNOWN),
    ],
)
def test_a_name_tells_what_decides_the_speed_of_a_port(path: str, kind: PortKind) -> None:
    assert port_kind(path) is kind


def test_a_symbolic_link_is_the_kind_of_port_that_it_points_to(tmp_path: Path) -> None:
    with PtyPort(tmp_path / "ttyUSB0") as device:
        assert port_kind(str(tmp_path / "ttyUSB0")) is port_kind(device.name) is PortKind.PTY


@pytest.mark.parametrize(("baud", "mtu"), [(None, 4096), (115_200, 240)])
def test_a_pty_has_a_speed_only_where_one_is_asked_for(baud: int | None, mtu: int) -> None:
    with PtyPort() as device, open_link(device.name, baud=baud) as host:
        assert host.mtu == mtu


@pytest.mark.parametrize(("wish", "is_on"), [(None, False), (False, False), (True, True)])
def test_the_handshake_is_on_where_it_is_asked_for(wish: bool | None, is_on: bool) -> None:
    import termios

    with PtyPort() as device, open_link(device.name, baud=3_000_000, rtscts=wish):
        looking = os.open(device.name, os.O_RDONLY | os.O_NOCTTY)
        flags = termios.tcgetattr(looking)[2]
        os.close(looking)
    assert bool(flags & termios.CRTSCTS) is is_on


@pytest.mark.parametrize(
    ("baud", "mtu"), [(115_200, 240), (230_400, 240), (921_600, 512), (3_000_000, 1024), (12_000_000, 4096)]
)
def test_slow_lines_have_short_packets(baud: int, mtu: int) -> None:
    assert mtu_for_baud(baud) == mtu


def test_a_tcp_server_lets_little_stand_between_it_and_a_client_that_does_not_read() -> None:
    with TcpServer() as server, TcpClient("127.0.0.1", server.port):
        assert server.read(1.0) == b""  # lets the client in
        taken = sum(server.write(bytes(1_000_000), 0.05) for _ in range(4))
        assert 16_384 <= taken < 400_000  # 8.5 MB where the system decides
