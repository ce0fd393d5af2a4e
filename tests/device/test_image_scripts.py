"""The image's scripts: the USB port as a serial port, and the way of an update to the system's updater."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from prismstereo_device.control.identity import device_id
from prismstereo_device.state import MemoryDisk, RealDisk
from prismstereo_device.update import UpdateInbox, write_bundle

IMAGE = Path(__file__).parents[2] / "device" / "image"


def gadget(root: Path, verb: str, *options: str, path: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["/bin/sh", IMAGE / "usb-gadget.sh", "-r", root, *options, verb],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": f"{path}:{os.environ['PATH']}"},
    )


@pytest.fixture
def board(tmp_path: Path) -> Path:
    """A folder that stands in for a board with one USB device controller."""
    for folder in ("sys/kernel/config/usb_gadget", "sys/class/udc/fe980000.usb", "etc"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "etc" / "machine-id").write_text("0123456789abcdef0123456789abcdef\n")
    return tmp_path


def files(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_the_gadget_is_a_serial_port_with_the_cameras_number_and_stops_without_a_trace(board: Path) -> None:
    gadgets = board / "sys" / "kernel" / "config" / "usb_gadget"
    for _ in range(2):  # a start over what is there already begins anew
        assert gadget(board, "start").returncode == 0
    made = files(gadgets / "prismstereo")
    assert made == {
        "idVendor": "0x1d6b\n",
        "idProduct": "0x0104\n",
        "bcdDevice": "0x0100\n",
        "bcdUSB": "0x0200\n",
        "bDeviceClass": "0x02\n",
        "strings/0x409/serialnumber": device_id(MemoryDisk(), (board / "etc" / "machine-id",)).hex() + "\n",
        "strings/0x409/manufacturer": "prismstereo\n",
        "strings/0x409/product": "prismstereo camera\n",
        "configs/c.1/strings/0x409/configuration": "serial port\n",
        "configs/c.1/MaxPower": "250\n",
        "UDC": "fe980000.usb\n",
    }
    link = gadgets / "prismstereo" / "configs" / "c.1" / "acm.usb0"
    assert link.resolve() == gadgets / "prismstereo" / "functions" / "acm.usb0"
    for _ in range(2):
        assert gadget(board, "stop").returncode == 0
        assert list(gadgets.iterdir()) == []


def test_a_gadget_that_cannot_be_finished_is_taken_away_again(board: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "ln").write_text("#!/bin/sh\nexit 1\n")
    (broken / "ln").chmod(0o755)
    assert gadget(board, "start", path=str(broken)).returncode == 1
    assert list((board / "sys" / "kernel" / "config" / "usb_gadget").iterdir()) == []


def test_the_gadget_script_says_what_is_missing(board: Path) -> None:
    assert gadget(board, "begin").returncode == 2
    assert "serial number 'a b'" in gadget(board, "start", "-s", "a b").stderr
    (board / "etc" / "machine-id").unlink()
    assert "give a serial number with -s" in gadget(board, "start").stderr
    (board / "sys" / "class" / "udc" / "fe980000.usb").rmdir()
    assert "no USB device controller" in gadget(board, "start", "-s", "0001").stderr
    assert files(board / "sys") == {}


def test_a_dry_run_of_the_gadget_says_all_steps_and_takes_none(board: Path) -> None:
    done = gadget(board, "start", "-n", "-s", "0001")
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) == 16
    assert done.stdout.splitlines()[-1].startswith("echo 'fe980000.usb' > ")
    assert files(board / "sys") == {}


def test_a_received_update_reaches_the_updater_and_is_cleared_away(tmp_path: Path) -> None:
    state, took = tmp_path / "state", tmp_path / "took"
    key = tmp_path / "private.pem"
    private = Ed25519PrivateKey.generate()
    key.write_bytes(private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    (tmp_path / "payload").write_bytes(b"an image\0" * 9999)
    write_bundle(tmp_path / "payload", key, tmp_path / "bundle", product="prismstereo", version="2.0")
    disk = RealDisk(state)
    inbox = UpdateInbox(disk, private.public_key().public_bytes_raw(), product="prismstereo", installed_version="1")
    disk.write("staging/4.part", (tmp_path / "bundle").read_bytes())
    assert inbox.take("staging/4.part") is None

    def install(*command: object) -> int:
        return subprocess.run(
            ["/bin/sh", IMAGE / "install-update.sh", state, *map(str, command)], check=False, stderr=subprocess.DEVNULL
        ).returncode

    assert install("false") == 1
    assert inbox.waiting() is not None
    assert install("sh", "-c", f'cat -- "$1" > {took}', "-") == 0
    assert took.read_bytes() == b"an image\0" * 9999
    assert disk.names("update") == []
    assert install("false") == 0  # nothing waits, nothing is asked
