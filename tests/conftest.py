"""What the tests share: the built-in rigs, their nominal calibrations, planes in front of their twins, and real data.

`rig` is every built-in prism rig in turn, and everything that is named after it here belongs to that one. Frames and truths of
facing planes are rendered once per distance and kept for the whole run.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Truth, Twin

PRISM_RIGS = ("dslr-35mm", "oak-1", "pi-camera-v2")


@pytest.fixture(scope="session", autouse=True)
def _two_threads() -> Iterator[None]:
    """Let OpenCV use two cores, as the figures in the documents do, however many this machine has."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    yield
    cv2.setNumThreads(before)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real pictures with known truth that PRISMSTEREO_DATA names."""
    named = os.environ.get("PRISMSTEREO_DATA")
    if not named or not Path(named).is_dir():
        pytest.skip("real data: set PRISMSTEREO_DATA to the folder that holds them")
    return Path(named)


@pytest.fixture(scope="session", params=PRISM_RIGS)
def rig(request: pytest.FixtureRequest) -> Rig:
    """Each built-in rig with a prism, base to the lens."""
    return Rig.read(request.param)


@pytest.fixture(scope="session")
def oak() -> Rig:
    """The built-in rig for an OAK-1: the one that loses columns."""
    return Rig.read("oak-1")


@pytest.fixture(scope="session")
def dslr() -> Rig:
    """The built-in rig for a DSLR: the paper's camera."""
    return Rig.read("dslr-35mm")


@pytest.fixture(scope="session")
def small(oak: Rig) -> Rig:
    """An OAK-1 that is read out with a sixteenth of the pixels: quick, and with the same optics."""
    video = Mode(width=320, height=180, rate_hz=30.0)
    return msgspec.structs.replace(oak, camera=msgspec.structs.replace(oak.camera, video=video))


@pytest.fixture(scope="session")
def nominal(rig: Rig) -> Calibration:
    """The calibration that the rig file promises."""
    return Calibration.nominal(rig)


@pytest.fixture(scope="session")
def rectified(nominal: Calibration) -> Rectification:
    """The rectification of the nominal calibration for the rig's own range."""
    return rectification(nominal)


@pytest.fixture(scope="session")
def pinhole_z_mm(rig: Rig, nominal: Calibration) -> float:
    """Z of the rectified pinholes in the rig frame: on the left view's optical axis, where depth is counted from."""
    view = fold(rig, "left")
    return float((view.paraxial_centre_mm + nominal.nearest_pinholes().shift * view.R[2])[2])


@pytest.fixture(scope="session")
def plane_twin(rig: Rig) -> Callable[[float], Twin]:
    """The rig's twin in front of a textured plane at z (mm) of the rig frame, made once per distance."""
    return cache(lambda distance_mm: Twin(rig, facing_plane(rig, distance_mm)))


@pytest.fixture(scope="session")
def plane_frame(plane_twin: Callable[[float], Twin]) -> Callable[[float], RawFrame]:
    """The raw frame of a plane at a distance (mm), rendered once."""
    return cache(lambda distance_mm: plane_twin(distance_mm).frame())


@pytest.fixture(scope="session")
def plane_truth(plane_twin: Callable[[float], Twin]) -> Callable[[float], Truth]:
    """The truth behind a plane at a distance (mm), computed once."""
    return cache(lambda distance_mm: plane_twin(distance_mm).truth())


@pytest.fixture
def rng() -> np.random.Generator:
    """Randomness that is the same on every run."""
    return np.random.default_rng(2010)
