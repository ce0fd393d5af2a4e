from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from host.calibrated_source import eventually
from host.command import in_process
from host.small_device import SmallDevice
from prismstereo.discovery import found_ports, found_sensors, sensor_port, the_only_sensor
from prismstereo.opening import open_camera
from prismstereo_device.link import PortError
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_hw.errors import DeviceError, UsageError


class Port(ListPortInfo):
    """A port as the system tells of it."""

    def __init__(
        self, device: str, serial_number: str = "", maker: str = "", ids: tuple[int, int] | None = None
    ) -> None:
        super().__init__(device, skip_link_detection=True)
        self.vid, self.pid = ids or (None, None)
        self.serial_number, self.manufacturer = serial_number or None, maker or None


GADGET = (0x1D6B, 0x0104)
OURS = Port("/dev/ttyACM1", "9f3c01", "prismstereo", GADGET)
OTHER_GADGET = Port("/dev/ttyACM0", "77", "Somebody", GADGET)
UART = Port("/dev/ttyS0")


def ports(*found: ListPortInfo) -> Callable[[], list[ListPortInfo]]:
    return lambda: list(found)


def test_the_numbers_here_are_those_that_the_camera_gives_itself() -> None:
    script = Path(__file__).parents[2] / "device" / "image" / "usb-gadget.sh"
    text = script.read_text()
    assert f'idVendor" 0x{GADGET[0]:04x}' in text
    assert f'idProduct" 0x{GADGET[1]:04x}' in text
    assert 'manufacturer" prismstereo' in text


def test_a_sensor_is_known_by_its_usb_identity_and_no_other_gadget_is_taken_for_one() -> None:
    listing = ports(UART, OURS, OTHER_GADGET)
    assert [found.port for found in found_ports(listing)] == ["/dev/ttyACM0", "/dev/ttyACM1", "/dev/ttyS0"]
    assert [(found.port, found.serial_number) for found in found_sensors(listing)] == [("/dev/ttyACM1", "9f3c01")]
    assert the_only_sensor(listing).port == "/dev/ttyACM1"
    assert sensor_port("9F3C01", listing) == "/dev/ttyACM1"


def test_none_or_several_is_an_error_with_the_mend() -> None:
    with pytest.raises(DeviceError, match="no sensor is plugged in over USB: plug one in"):
        the_only_sensor(ports(UART, OTHER_GADGET))
    twins = ports(OURS, Port("/dev/ttyACM2", "9f3c02", "prismstereo", GADGET))
    with pytest.raises(UsageError, match=r"2 sensors .*/dev/ttyACM1 \(serial:9f3c01\), /dev/ttyACM2 \(serial:9f3c02\)"):
        open_camera(listing=twins)
    with pytest.raises(PortError, match="'77' is plugged in: there are 9f3c01, 9f3c02"):
        open_camera("serial:77", listing=twins)
    with pytest.raises(UsageError, match="serial: without a number"):
        open_camera("serial:", listing=twins)


@pytest.mark.parametrize("target", [None, "serial:9f3c01"])
def test_a_sensor_that_comes_back_at_another_port_is_found_by_its_serial_number(target: str | None) -> None:
    there: list[ListPortInfo] = []
    with PtyPort() as first:
        there[:] = [Port(first.name, "9f3c01", "prismstereo", GADGET)]
        device = SmallDevice(first, boot_id=1)
        camera = open_camera(target, listing=lambda: there)
        assert camera.identity.device_id == b"serial-1"
    device.stop()
    with camera, PtyPort() as second, SmallDevice(second, boot_id=1):
        there[:] = [Port(second.name, "9f3c01", "prismstereo", GADGET)]
        eventually(lambda: camera.statistics.replugs == 1)


def test_the_verb_lists_sensors_by_the_number_that_opens_them(monkeypatch: pytest.MonkeyPatch) -> None:
    from prismstereo.cli.devices import command

    monkeypatch.setattr("prismstereo.discovery._system_ports", ports(UART, OURS))
    code, text = in_process(command)
    assert code == 0
    assert "/dev/ttyACM1  prismstereo sensor, serial:9f3c01" in text
