"""What is installed on a camera: parts of the project's lock, complete, and enough to stream."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from device.service_host import Host
from prismstereo_calibration import schema
from prismstereo_calibration.model import Calibration
from prismstereo_device.link.tcp import TcpClient
from prismstereo_device.wire import Channel
from prismstereo_hw.rig import Rig

ROOT = Path(__file__).parents[2]
IMAGE = ROOT / "device" / "image"


@pytest.fixture(scope="module")
def lock() -> ModuleType:
    """The script that makes the camera's locks."""
    spec = importlib.util.spec_from_file_location("image_lock", IMAGE / "lock.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_cameras_locks_are_parts_of_the_projects_lock(lock: ModuleType) -> None:
    project = (ROOT / "requirements.lock").read_text()
    for file, names in lock.LOCKS.items():
        assert (IMAGE / file).read_text() == lock.selected(project, names), "run `python device/image/lock.py`"
        assert "--hash=sha256:" in (IMAGE / file).read_text()


def test_the_cameras_lock_has_all_that_its_entries_need_and_nothing_for_the_desk(lock: ModuleType) -> None:
    needed: set[str] = set()
    for name in lock.CAMERA:
        for line in importlib.metadata.requires(name) or []:
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                needed.add(canonicalize_name(requirement.name))
    assert needed <= set(lock.CAMERA)
    assert not {"depthai", "onnxruntime", "scipy", "click", "rich", "reportlab", "pyyaml"} & set(lock.CAMERA)


ONLY_THE_CAMERAS = """
import importlib.metadata, sys
allowed = set(sys.argv[1].split(","))
desk = {top for top, names in importlib.metadata.packages_distributions().items()
        if not {name.lower().replace("_", "-") for name in names} & allowed}
class Guard:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in desk:
            raise ModuleNotFoundError(f"{name} is not on a camera", name=name)
sys.meta_path.insert(0, Guard())
from prismstereo_device.__main__ import main
main(sys.argv[2:])
"""


@pytest.fixture
def pictures(small: Rig, tmp_path: Path) -> list[str]:
    """What to tell the firmware to replay two small pictures whose halves show the same."""
    rng = np.random.default_rng(2010)
    half = cv2.GaussianBlur(rng.integers(0, 256, (180, 160, 3), dtype=np.uint8), (5, 5), 0)
    for number in range(2):
        assert cv2.imwrite(str(tmp_path / f"{number:06}.png"), np.hstack([half, half]))
    (tmp_path / "calibration.json").write_bytes(schema.encode(Calibration.nominal(small)))
    return ["--sensor", f"replay:{tmp_path}", "--calibration", str(tmp_path / "calibration.json")]


def test_the_firmware_streams_with_nothing_installed_but_what_its_lock_has(
    lock: ModuleType, pictures: list[str]
) -> None:
    allowed = ",".join((*lock.CAMERA, "prismstereo"))
    arguments = [*pictures, "--matcher", "bm", "--lossless", "--link", "tcp:127.0.0.1:0"]
    with subprocess.Popen(
        [sys.executable, "-c", ONLY_THE_CAMERAS, allowed, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    ) as firmware:
        try:
            assert firmware.stdout is not None
            line = firmware.stdout.readline()
            assert line, firmware.stderr and firmware.stderr.read()
            address, _, port = json.loads(line)["listening"].removeprefix("tcp:").removeprefix("//").rpartition(":")
            with TcpClient(address, int(port)) as link:
                host = Host(link)
                host.meet()
                host.hear_until(lambda: bool(host.frames), 60, acknowledge=True)
        finally:
            firmware.terminate()
            firmware.communicate(timeout=30)
    assert host.on(Channel.DISP)
    assert (host.frames[0].disparity.valid).any()
