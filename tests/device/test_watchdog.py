from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from prismstereo_device.serving.watchdog import Notifier

pytestmark = pytest.mark.skipif(
    not hasattr(socket, "AF_UNIX"), reason="service managers with such a socket are on Linux"
)


class Manager:
    """The service manager's end."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address[0] == "@" else address)
        self._socket.settimeout(0.0)

    def told(self) -> list[str]:
        lines = []
        try:
            while True:
                lines.append(self._socket.recv(4096).decode())
        except BlockingIOError:
            return lines

    def close(self) -> None:
        self._socket.close()


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    abstract = f"@prismstereo-test-{os.getpid()}"
    made = Manager(abstract if request.param == "abstract" else str(tmp_path / "notify"))
    yield made
    made.close()


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_the_manager_is_told_once_that_it_is_ready_and_each_new_status(manager: Manager) -> None:
    with Notifier(manager.address) as notifier:
        notifier.ready()
        notifier.ready()
        notifier.status("waiting\nfor a host")
        notifier.status("waiting for a host")
        notifier.status("a host is served")
        notifier.stopping()
    assert manager.told() == [
        "READY=1",
        "STATUS=waiting for a host",
        "STATUS=a host is served",
        "STOPPING=1",
    ]


def test_signs_of_life_come_four_times_in_the_watchdogs_time_however_many_frames_there_are(manager: Manager) -> None:
    clock = Clock()
    with Notifier(manager.address, watchdog_s=10.0, clock_s=clock) as notifier:
        for _ in range(2000):
            notifier.kick()
            clock.now_s += 0.01
    assert manager.told() == ["WATCHDOG=1"] * 8


def test_without_a_watchdog_no_sign_of_life_is_sent(manager: Manager) -> None:
    with Notifier(manager.address) as notifier:
        notifier.kick()
    assert manager.told() == []


def test_the_environment_names_socket_and_time(manager: Manager) -> None:
    environment = {"NOTIFY_SOCKET": manager.address, "WATCHDOG_USEC": "10000000", "WATCHDOG_PID": str(os.getpid())}
    with Notifier.from_environment(environment) as notifier:
        notifier.ready()
        notifier.kick()
    assert manager.told() == ["READY=1", "WATCHDOG=1"]


@pytest.mark.parametrize("usec", ["", "0", "-5", "ten", "٣"])
def test_a_time_that_makes_no_sense_is_as_good_as_none(manager: Manager, usec: str) -> None:
    with Notifier.from_environment({"NOTIFY_SOCKET": manager.address, "WATCHDOG_USEC": usec}) as notifier:
        notifier.kick()
    assert manager.told() == []


def test_another_process_watchdog_is_not_ours_to_feed(manager: Manager) -> None:
    environment = {"NOTIFY_SOCKET": manager.address, "WATCHDOG_USEC": "1000000", "WATCHDOG_PID": "1"}
    with Notifier.from_environment(environment) as notifier:
        notifier.kick()
        notifier.ready()
    assert manager.told() == ["READY=1"]


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "vsock:2:1234"}])
def test_without_a_manager_nothing_happens(environment: dict[str, str]) -> None:
    with Notifier.from_environment(environment) as notifier:
        notifier.ready()
        notifier.kick()
        notifier.stopping()


def test_a_manager_that_is_gone_or_never_reads_stops_nothing(tmp_path: Path) -> None:
    with Notifier(str(tmp_path / "nobody")) as notifier:
        notifier.ready()
    manager = Manager(str(tmp_path / "deaf"))
    with Notifier(manager.address, watchdog_s=1e-9) as notifier:
        for _ in range(5000):
            notifier.kick()
    manager.close()
