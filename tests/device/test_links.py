from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from prismstereo_device.link import Link, LinkLost, PortError, open_link
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.link.serial_port import SerialPort, read_what_waits, write_in_pieces
from prismstereo_device.link.tcp import TcpClient, TcpServer

Pair = tuple[Link, Link]
GONE = r"closed|went away|gone"
MEGABYTE = bytes(range(256)) * 4096


def connected_tcp(server: TcpServer) -> TcpClient:
    client = TcpClient("127.0.0.1", server.port)
    assert server.read(1.0) == b""  # lets the client in
    return client


@pytest.fixture(params=["pty", "tcp", "loopback"])
def pair(request: pytest.FixtureRequest) -> Iterator[Pair]:
    """The camera's end and the host's."""
    if request.param == "pty":
        device: Link = PtyPort()
        host: Link = SerialPort(device.name)
    elif request.param == "tcp":
        server = TcpServer()
        device, host = server, connected_tcp(server)
    else:
        device, host = loopback()
    with device, host:
        yield device, host


def pump(source: Link, data: bytes) -> threading.Thread:
    def run() -> None:
        rest = data
        while rest:
            rest = rest[source.write(rest, 0.5) :]

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def drain(sink: Link, size: int, timeout_s: float = 10.0) -> bytes:
    got, deadline = bytearray(), time.monotonic() + timeout_s
    while len(got) < size and time.monotonic() < deadline:
        got += sink.read(0.2)
    return bytes(got)


def test_a_megabyte_passes_unchanged_both_ways_at_once(pair: Pair) -> None:
    device, host = pair
    writers = [pump(device, MEGABYTE), pump(host, MEGABYTE[::-1])]
    back: list[bytes] = []
    reader = threading.Thread(target=lambda: back.append(drain(device, len(MEGABYTE))))
    reader.start()
    forth = drain(host, len(MEGABYTE))
    for thread in [*writers, reader]:
        thread.join()
    assert forth == MEGABYTE
    assert back == [MEGABYTE[::-1]]


def test_every_byte_value_passes_raw(pair: Pair) -> None:
    device, host = pair
    everything = bytes(range(256))  # a cooked terminal would change 3, 4, 10, 13, 17, 19, 26, 28, 127
    assert host.write(everything) == 256
    assert drain(device, 256) == everything


def test_reading_nothing_takes_its_time_and_no_longer(pair: Pair) -> None:
    for end in pair:
        begin = time.monotonic()
        assert end.read(0.05) == b""
        assert 0.04 <= time.monotonic() - begin < 1.0


def test_writing_to_a_host_that_never_reads_comes_back_in_time(pair: Pair) -> None:
    device, _ = pair
    begin = time.monotonic()
    taken = device.write(MEGABYTE * 16, 0.2)
    assert 0 < taken < len(MEGABYTE) * 16
    assert time.monotonic() - begin < 2.0
    assert device.write(b"more", 0.0) in range(5)


def test_a_closed_end_says_that_the_link_is_lost(pair: Pair) -> None:
    for end in pair:
        end.close()
        end.close()
        with pytest.raises(LinkLost, match=GONE):
            end.read(0.1)
        with pytest.raises(LinkLost, match=GONE):
            end.write(b"x")


def test_the_host_notices_that_the_camera_is_gone(pair: Pair) -> None:
    device, host = pair
    device.close()
    with pytest.raises(LinkLost):
        host.read(1.0)


def test_a_serial_port_that_was_pulled_out_says_so_whatever_is_done_with_it() -> None:
    device = PtyPort()
    with SerialPort(device.name) as host:
        device.close()
        with pytest.raises(LinkLost, match="check the cable"):
            host.write(b"x")
        with pytest.raises(LinkLost, match="check the cable"):
            host.read(0.1)


def test_a_pty_outlives_its_hosts() -> None:
    with PtyPort() as device:
        for greeting in (b"first", b"second", b"third"):
            with SerialPort(device.name) as host:
                host.write(greeting)
                assert drain(device, len(greeting)) == greeting
                device.write(greeting)
                assert drain(host, len(greeting)) == greeting
            assert device.read(0.02) == b""
            device.write(b"nobody hears this")


def test_a_host_does_not_see_what_came_before_it() -> None:
    with PtyPort() as device:
        device.write(b"old news")
        with SerialPort(device.name) as host:
            device.write(b"news")
            assert drain(host, 4) == b"news"


def test_a_port_belongs_to_one_host() -> None:
    with PtyPort() as device, SerialPort(device.name), pytest.raises(PortError, match="another program has it open"):
        SerialPort(device.name)


def test_a_symbolic_link_names_the_port_while_it_is_there(tmp_path: Path) -> None:
    path = tmp_path / "sensor"
    path.symlink_to("/dev/null-of-an-earlier-run")
    with PtyPort(path) as device, SerialPort(str(path)) as host:
        assert path.readlink() == Path(device.name)
        host.write(b"hello")
        assert drain(device, 5) == b"hello"
    assert not path.is_symlink()


def test_a_file_in_the_way_of_the_symbolic_link_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "sensor"
    path.write_text("mine")
    before = len(os.listdir("/dev/fd"))
    with pytest.raises(PortError, match="in the way"):
        PtyPort(path)
    assert path.read_text() == "mine"
    assert len(os.listdir("/dev/fd")) == before


def test_another_ports_symbolic_link_is_not_removed(tmp_path: Path) -> None:
    path = tmp_path / "sensor"
    with PtyPort(path), PtyPort(path) as newer:
        pass
    assert not path.is_symlink()
    with PtyPort(path) as older:
        path.unlink()
        path.symlink_to(newer.name)
        older.close()
        assert path.is_symlink()


def test_a_hundred_replugs_leak_nothing() -> None:
    before = len(os.listdir("/dev/fd"))
    for _ in range(100):
        with PtyPort() as device, SerialPort(device.name) as host:
            host.write(b"x")
            assert device.read(1.0) == b"x"
    assert len(os.listdir("/dev/fd")) == before


def test_a_serial_write_through_pyserial_alone_counts_what_was_taken() -> None:
    import serial

    with PtyPort() as device, serial.Serial(device.name) as port:
        assert write_in_pieces(port, b"x" * 1000, 0.5) == 1000
        assert drain(device, 1000) == b"x" * 1000
        taken = write_in_pieces(port, MEGABYTE, 0.2)
        assert 0 < taken < len(MEGABYTE)
        device.write(b"back")
        assert read_what_waits(port, 0.5) in (b"b", b"back")
        assert read_what_waits(port, 0.0) in (b"", b"ack")


def test_a_port_that_is_not_there_is_an_error_with_a_mend() -> None:
    with pytest.raises(
        PortError, match=r"/dev/ttyNOWHERE cannot be opened, it is not there: (the ports of|this computer has no)"
    ):
        open_link("/dev/ttyNOWHERE")


def test_a_file_that_is_no_port_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("text")
    with pytest.raises(PortError, match="cannot be opened"):
        open_link(str(tmp_path / "file"))


@pytest.mark.parametrize("form", ["tcp:127.0.0.1:{}", "tcp://127.0.0.1:{}", "TCP://localhost:{}/"])
def test_a_tcp_address_may_be_written_in_several_ways(form: str) -> None:
    with TcpServer() as server, open_link(form.format(server.port)) as client:
        client.write(b"hello")
        assert drain(server, 5) == b"hello"


@pytest.mark.parametrize(
    "port", ["tcp:", "tcp:host", "tcp:host:", "tcp::80", "tcp:host:0", "tcp:host:65536", "tcp:h:x1"]
)
def test_an_address_that_is_none_is_an_error(port: str) -> None:
    with pytest.raises(PortError, match="write tcp:HOST:PORT"):
        open_link(port)


def test_a_server_that_is_not_there_is_an_error() -> None:
    with TcpServer() as server:
        port = server.port
    with pytest.raises(PortError, match="cannot be reached"):
        open_link(f"tcp:127.0.0.1:{port}")


def test_a_server_listens_on_this_computer_alone_unless_told() -> None:
    with TcpServer() as server:
        assert server.name == f"tcp:127.0.0.1:{server.port}"
        with pytest.raises(PortError, match="cannot be served"):
            TcpServer(port=server.port)


def test_a_server_talks_to_one_client_at_a_time_and_outlives_it() -> None:
    with TcpServer() as server:
        with connected_tcp(server) as first:
            first.write(b"1")
            assert server.read(1.0) == b"1"
            with connected_tcp(server) as second, pytest.raises(LinkLost):
                second.read(1.0)
            server.write(b"still yours")
            assert drain(first, 11) == b"still yours"
        assert server.read(1.0) == b""  # the end of the first
        assert server.write(b"into the void") == 13
        with connected_tcp(server) as third:
            third.write(b"3")
            assert server.read(1.0) == b"3"


def test_a_client_that_left_with_words_unread_makes_room_at_once() -> None:
    with TcpServer() as server:
        for _ in range(20):
            with connected_tcp(server) as leaving:
                leaving.write(MEGABYTE[:5000])
            with TcpClient("127.0.0.1", server.port) as coming:
                assert drain(server, 5000, timeout_s=1.0) == MEGABYTE[:5000]
                server.read(0.0)
                server.write(b"welcome")
                assert drain(coming, 7) == b"welcome"


def test_a_client_that_fell_silent_gives_way_to_the_next() -> None:
    with TcpServer(silent_s=0.05) as server, connected_tcp(server) as silent:
        time.sleep(0.1)
        with connected_tcp(server) as newer:
            server.write(b"for the newer one")
            assert drain(newer, 17) == b"for the newer one"
            with pytest.raises(LinkLost):
                silent.read(1.0)


def test_the_loopback_holds_no_more_than_its_capacity() -> None:
    device, host = loopback(capacity=1000)
    assert device.write(bytes(5000), 0.05) == 1000
    assert len(host.read(0.1)) == 1000
    assert host.read(0.0) == b""


def test_what_was_sent_before_the_loopback_closed_is_still_read() -> None:
    device, host = loopback()
    device.write(b"last words")
    device.close()
    assert host.read(0.1) == b"last words"
    with pytest.raises(LinkLost):
        host.read(0.1)
