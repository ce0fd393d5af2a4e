from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from host.export_frames import flat_calibration, frame_of
from host.ros_world import ROS2
from prismstereo.clock import ClockMapping
from prismstereo.export.ros_messages import FrameNames
from prismstereo_calibration import flash
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.rig import Rig


@pytest.fixture(scope="module")
def content(small: Rig) -> bytes:
    return flash.pack(flat_calibration(small))


def test_the_scan_points_at_the_zones(content: bytes) -> None:
    from prismstereo.export.ros_scan import laser_scan

    geometry = frame_of(flash.unpack(content)).geometry
    zones = ZoneDistances(0, 0, np.array([[700, 0, 65535, 900], [800, 0, 0, 500]], np.uint16))

    scan = laser_scan(zones, geometry, 0, FrameNames().link, 0.1).fields

    ranges = scan["ranges"]
    assert isinstance(ranges, np.ndarray)
    angles = float(str(scan["angle_min"])) + float(str(scan["angle_increment"])) * np.arange(len(ranges))
    assert scan["angle_max"] == pytest.approx(angles[-1])
    ahead = ranges * np.cos(angles)
    columns = ((geometry.cx_px - geometry.focal_px * np.tan(angles)) + 0.5) // (geometry.width / 4)
    for column, expected in enumerate((0.7, np.nan, np.inf, 0.5)):  # left to right in the picture
        found = ahead[columns == column]
        assert len(found) >= 3
        np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert angles[0] < angles[-1]  # anticlockwise: the right border comes first
    assert columns[0] == 3


def test_diagnostics_judge_the_line(content: bytes) -> None:
    from prismstereo.driver import CameraStatistics
    from prismstereo.events import CameraState
    from prismstereo.export.ros_diagnostics import Level, diagnostic_array
    from prismstereo_device.framing import LineStatistics

    def judged(state: CameraState, frames: int, lost: int) -> tuple[int, str]:
        before, now = (
            CameraStatistics(f, 0, gone, 0, 0, LineStatistics(), None, None)
            for f, gone in ((100, 0), (100 + frames, lost))
        )
        array = diagnostic_array("eye", "id", state, now, before, stamp_ns=0, period_s=1.0)
        statuses = array.fields["status"]
        assert isinstance(statuses, tuple)
        fields: Any = statuses[0].fields
        return fields["level"].value, fields["message"]

    assert judged(CameraState.CONNECTED, 30, 0) == (Level.OK, "30.0 frames a second")
    assert judged(CameraState.CONNECTED, 0, 0)[0] == Level.STALE
    assert judged(CameraState.CONNECTED, 15, 15) == (
        Level.WARN,
        "50 % of the frames are lost or lack stripes: the line is slow, or disturbed",
    )
    assert judged(CameraState.SEARCHING, 0, 0)[0] == Level.ERROR


def test_stamps_are_ros_time_of_the_exposure_and_not_of_the_arrival(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROS2))
    from prismstereo_ros.stamps import stamp_ns

    clock = ClockMapping(offset_us=5_000_000.0, skew_ppm=0.0, bound_us=100.0, at_device_us=0)

    # exposed at 2 s of the camera's clock, which is 7 s of this computer's; that is at 7.04 s when the frame is handed on
    known = stamp_ns(2_000_000, clock, now_ns=1_700_000_000_000_000_000, monotonic_ns=7_040_000_000)

    assert known == 1_700_000_000_000_000_000 - 40_000_000
    assert stamp_ns(2_000_000, None, now_ns=9, monotonic_ns=7_040_000_000) == 9
