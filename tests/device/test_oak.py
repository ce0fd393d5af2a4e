"""OAK cameras against depthai as it is installed: the graphs by its own stubs, messages, queues and settings for real."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from device.oak_recorder import NotInStubs, Recorder
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.sensors.oak import open_oak, open_oak_stereo
from prismstereo_device.sensors.oak.calibration_handover import calibration_handler
from prismstereo_device.sensors.oak.eeprom_backup import back_up
from prismstereo_device.sensors.oak.graph import capture_graph, stereo_graph
from prismstereo_device.sensors.oak.library import load_depthai
from prismstereo_device.sensors.oak.on_device_stereo import StereoPlan
from prismstereo_device.sensors.oak.opening import OakCamera, run
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_hw.errors import DeviceError, UsageError
from prismstereo_hw.rig import Rig

BASELINE_CM = 5.032428  # of the two pinholes that come nearest to the oak-1's views through its glass


@pytest.fixture(scope="module")
def dai() -> Any:
    pytest.importorskip("depthai")
    return load_depthai()


@pytest.fixture(scope="module")
def plan() -> StereoPlan:
    return StereoPlan.of(Calibration.nominal(Rig.read("oak-1")), OakOptions())


# ---- the recorder itself: what is not in the stubs does not pass


@pytest.mark.parametrize(
    ("mistake", "complaint"),
    [
        (lambda dai, p: p.create(dai.node.StereoDepth).setRectify(False), "StereoDepth has no setRectify"),
        (lambda dai, p: p.create(dai.node.StereoDepth).setInputResolution(1, 2, 3), "setInputResolution takes"),
        (lambda dai, p: p.create(dai.node.StereoDepth).setInputResolution(640), "setInputResolution takes"),
        (lambda dai, p: p.create(dai.node.StereoDepth).setInputResolution(640.0, 720.0), "setInputResolution takes"),
        (lambda dai, p: p.create(dai.node.StereoDepth).setRectification(1), "setRectification takes"),
        (lambda dai, p: p.create(dai.node.StereoDepth).setRectification(on=False), "setRectification takes"),
        (lambda dai, p: p.create(dai.node.StereoDepth).setDepthAlign(dai.LogLevel.OFF), "setDepthAlign takes"),
        (lambda dai, p: p.create(dai.node.StereoDepth).middle, "StereoDepth has no middle"),
        (lambda dai, p: p.create(dai.node.Gate).output.link(p.create(dai.node.Gate).output), "link takes"),
        (lambda dai, p: p.create(dai.node.Gate).input.link(p.create(dai.node.Gate).output), "Input has no link"),
        (lambda dai, p: p.create(dai.node.Warp).setWarpMesh([(0.0, 0.0, 0.0)], 1, 1), "setWarpMesh takes"),
        (lambda dai, p: setattr(p.create(dai.node.Gate), "initialConfig", 3), "initialConfig takes"),
        (lambda dai, p: setattr(p.create(dai.node.Gate), "state", 3), r"Gate\.state cannot be set"),
        (lambda dai, p: p.setAutoCalibrationMode("OFF"), "setAutoCalibrationMode takes"),
        (lambda dai, p: p.create(dai.ImgFrame), "is no node"),
        (lambda dai, p: p.create(dai.node.Camera).requestOutput((640, 360), fps="30"), "requestOutput takes"),
    ],
)
def test_a_mistake_in_a_graph_is_noticed(dai: Any, mistake: Callable[[Any, Any], Any], complaint: str) -> None:
    with pytest.raises(NotInStubs, match=complaint):
        mistake(dai, Recorder(dai).pipeline)


def test_what_one_kind_of_camera_refuses_is_refused_for_it_alone(dai: Any) -> None:
    Recorder(dai, "RVC2").pipeline.create(dai.node.StereoDepth).setOutputSize(640, 720)
    with pytest.raises(NotInStubs, match="setOutputSize is refused on RVC4"):
        Recorder(dai, "RVC4").pipeline.create(dai.node.StereoDepth).setOutputSize(640, 720)


# ---- the graphs


def test_capture_gives_whole_frames_as_they_are_and_stills_behind_a_gate(dai: Any) -> None:
    recorder = Recorder(dai)
    ports = capture_graph(dai, recorder.pipeline, OakOptions(), focus=130)
    assert recorder.calls[0].arguments == (dai.Pipeline.AutoCalibrationMode.OFF,)  # before anything else
    asked = next(call for call in recorder.calls if call.method == "requestOutput")
    assert asked.arguments == ((1280, 720),)
    assert asked.keywords["enableUndistortion"] is False
    assert recorder.links == [("Camera0.requestFullResolutionOutput0", "Gate0.input")]
    assert recorder.nodes["Gate0"].initialConfig.open is False
    control = recorder.nodes["Camera0"].initialControl
    assert control.getCommand(dai.CameraControl.Command.MOVE_LENS)
    assert (control.getLensPosition(), control.autoFocusMode) == (130, dai.CameraControl.AutoFocusMode.OFF)
    assert None not in (ports.frames, ports.control, ports.stills, ports.gate)


def test_without_stills_there_is_one_output_and_without_a_motor_no_focus(dai: Any) -> None:
    recorder = Recorder(dai)
    ports = capture_graph(dai, recorder.pipeline, OakOptions(stills=False, pixels="gray8"), focus=None)
    assert (ports.stills, ports.gate, recorder.links) == (None, None, [])
    assert not recorder.nodes["Camera0"].initialControl.getCommand(dai.CameraControl.Command.MOVE_LENS)
    asked = next(call for call in recorder.calls if call.method == "requestOutput")
    assert asked.keywords["type"] == dai.ImgFrame.Type.GRAY8


@pytest.mark.parametrize("platform", ["RVC2", "RVC4"])
def test_both_views_come_from_one_camera_and_reach_the_engine_rectified_and_renumbered(
    dai: Any, plan: StereoPlan, platform: str
) -> None:
    recorder, options = Recorder(dai, platform), OakOptions.parse("?mode=stereo&confidence=1&preview=1&threshold=20")
    handler = calibration_handler(dai, plan.calibration, plan.made)
    ports = stereo_graph(dai, recorder.pipeline, options, plan.meshes, plan.size, handler, focus=None)
    for number, side in enumerate(("left", "right")):
        way = ["Camera0.requestOutput0", f"ImageManip{number}", f"Warp{number}", f"Script{number}", "StereoDepth0"]
        ends = ["inputImage", "inputImage", "inputs[in]", side]
        begins = ["", ".out", ".out", ".outputs[out]"]
        for one, begin, other, end in zip(way, begins, way[1:], ends, strict=False):
            assert (one + begin, f"{other}.{end}") in recorder.links
        assert f"setInstanceNum({number + 1})" in recorder.called(f"Script{number}", "setScript")[0][0]
        points, columns, rows = recorder.called(f"Warp{number}", "setWarpMesh")[0]
        assert (len(points), columns, rows) == (41 * 46, 41, 46)
        assert recorder.called(f"Warp{number}", "setOutputSize") == [((640, 720),)]
    assert len(recorder.links) == 8
    assert recorder.calls[0].arguments == (dai.Pipeline.AutoCalibrationMode.OFF,)
    assert recorder.called("pipeline", "setCalibrationData") == [(handler,)]
    assert recorder.called("StereoDepth0", "setRectification") == [(False,)]
    assert recorder.called("StereoDepth0", "setInputResolution") == [(640, 720)]
    assert recorder.called("StereoDepth0", "setLeftRightCheck") == [(True,)]
    assert recorder.called("StereoDepth0", "setSubpixelFractionalBits") == [(4,)]
    config = recorder.nodes["StereoDepth0"].initialConfig
    after = config.postProcessing
    assert (config.getConfidenceThreshold(), config.getMedianFilter()) == (20, dai.MedianFilter.MEDIAN_OFF)
    assert after.decimationFilter.decimationFactor == 1
    filling = (
        after.holeFilling,
        after.adaptiveMedianFilter,
        after.temporalFilter,
        after.spatialFilter,
        after.speckleFilter,
    )
    assert [each.enable for each in filling] == [False] * 5
    assert None not in (ports.disparity, ports.control, ports.confidence, ports.preview)


def test_what_is_set_on_the_engine_is_what_its_own_configuration_then_says(dai: Any, plan: StereoPlan) -> None:
    recorder, options = Recorder(dai), OakOptions.parse("?mode=stereo&bits=3&median=7&shift=48&extended=1")
    handler = calibration_handler(dai, plan.calibration, plan.made)
    stereo_graph(dai, recorder.pipeline, options, plan.meshes, plan.size, handler, focus=None)
    config = recorder.nodes["StereoDepth0"].initialConfig
    assert config.algorithmControl.disparityShift == 48
    assert config.getMedianFilter() == dai.MedianFilter.KERNEL_7x7
    engine = dai.StereoDepthConfig().setSubpixel(True).setExtendedDisparity(True).setSubpixelFractionalBits(3)
    assert options.stereo.labels == 48 + engine.getMaxDisparity() / 2**3 + 2  # 0 to 190, and one to spare


# ---- the calibration handed over, and the camera's own kept


def test_the_handler_is_valid_to_depthai_and_says_our_focal_length_and_baseline(dai: Any, plan: StereoPlan) -> None:
    handler = calibration_handler(dai, plan.calibration, plan.made)
    handler.validateCalibrationHandler()
    again = dai.CalibrationHandler.fromJson(handler.eepromToJson())
    left, right = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    assert again.getBaselineDistance(left, right, useSpecTranslation=False) == pytest.approx(BASELINE_CM, rel=1e-6)
    assert (again.getStereoLeftCameraId(), again.getStereoRightCameraId()) == (left, right)
    R_and_t = np.array(again.getCameraExtrinsics(left, right))
    np.testing.assert_allclose(R_and_t[:3, :3], np.eye(3), atol=1e-7)
    assert R_and_t[0, 3] == pytest.approx(-BASELINE_CM, rel=1e-6)  # the right one stands to the right
    for socket, cx_px in ((left, plan.made.left.cx_px), (right, plan.made.right.cx_px)):
        K = np.array(again.getCameraIntrinsics(socket))
        np.testing.assert_allclose([K[0, 0], K[0, 2], K[1, 2]], [933.698, cx_px, plan.made.cy_px], rtol=1e-5)
        assert not any(again.getDistortionCoefficients(socket))
    lens = plan.calibration.left.lens
    np.testing.assert_allclose(again.getCameraIntrinsics(dai.CameraBoardSocket.CAM_A), lens.K, rtol=1e-6)
    pipeline = dai.Pipeline(createImplicitDevice=False)
    pipeline.setCalibrationData(handler)
    assert pipeline.getCalibrationData().getBaselineDistance(left, right) == pytest.approx(BASELINE_CM, rel=1e-6)


def test_a_calibration_without_a_unit_and_a_camera_on_a_virtual_socket_are_refused(dai: Any, plan: StereoPlan) -> None:
    pinholes = replace(plan.calibration.pinholes(), left=replace(plan.calibration.left, plate=None))
    squares = replace(pinholes, right=replace(pinholes.right, plate=None), unit="square")
    with pytest.raises(UsageError, match="board squares: calibrate with --square-mm"):
        calibration_handler(dai, squares, rectification(squares))
    with pytest.raises(UsageError, match="at CAM_B or CAM_C, which the virtual pair needs"):
        calibration_handler(dai, plan.calibration, plan.made, socket=2)


def test_the_cameras_own_calibration_is_kept_once_and_never_written_over(dai: Any, tmp_path: Path) -> None:
    handler = dai.CalibrationHandler()
    handler.setBoardInfo("OAK-1", "R1")

    def empty() -> Any:
        raise RuntimeError("EEPROM is empty")

    answers = {"getDeviceId": "1844/../A1", "readCalibration": handler, "readFactoryCalibration": empty}
    answers |= {"readCalibrationRaw": b"\x00\x7f", "readFactoryCalibrationRaw": empty}
    path = back_up(Recorder(dai, answers=answers).device, tmp_path / "kept")
    kept = json.loads(path.read_text())
    assert (kept["user"]["boardName"], kept["factory"], kept["device_id"]) == ("OAK-1", None, "1844/../A1")
    assert (kept["user_bytes"], kept["factory_bytes"]) == ("007f", None)
    assert path.parent == tmp_path / "kept"  # whatever a device calls itself
    before = path.stat()
    assert back_up(Recorder(dai, answers=answers).device, tmp_path / "kept") == path
    assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    handler.setBoardInfo("OAK-1", "R2")
    assert back_up(Recorder(dai, answers=answers).device, tmp_path / "kept") != path
    assert len(list((tmp_path / "kept").iterdir())) == 2  # and nothing unfinished
    (tmp_path / "file").touch()
    with pytest.raises(DeviceError, match=r"cannot be backed up .*: give a folder that can be written to"):
        back_up(Recorder(dai, answers=answers).device, tmp_path / "file")


# ---- opening


def features(dai: Any, *, motor: bool) -> Any:
    made, config = dai.CameraFeatures(), dai.CameraSensorConfig()
    config.width, config.height, config.maxFps, config.type = 4056, 3040, 30.0, dai.CameraSensorType.COLOR
    made.socket, made.configs, made.hasAutofocus = dai.CameraBoardSocket.CAM_A, [config], motor
    return made


def answers(dai: Any, *, motor: bool = True, focus: int = 120) -> dict[str, Any]:
    handler = dai.CalibrationHandler()
    handler.setCameraIntrinsics(dai.CameraBoardSocket.CAM_A, np.eye(3).tolist(), dai.Size2f(4056, 3040))
    handler.setLensPosition(dai.CameraBoardSocket.CAM_A, focus)
    temperature = dai.ChipTemperature()
    temperature.average = 41.5
    return {
        "getConnectedCameraFeatures": [features(dai, motor=motor)],
        "getPlatformAsString": "RVC2",
        "getDeviceId": "18443010A1B2C3",
        "readCalibrationOrDefault": handler,
        "getChipTemperature": temperature,
        "addLogCallback": 1,
    }


def test_a_camera_is_opened_looked_at_started_and_stopped(dai: Any) -> None:
    recorder, options = Recorder(dai, answers=answers(dai)), OakOptions()
    offline = recorder.module()
    running = run(
        offline,
        "",
        lambda device: OakCamera.of(dai, device, options),
        lambda pipeline, camera: capture_graph(offline, pipeline, options, focus=camera.focus),
    )
    assert (running.camera.focus, running.camera.has_motor, running.chip_c()) == (120, True, 41.5)
    assert [(mode.width, mode.height, mode.rate_hz) for mode in running.camera.modes] == [(4056, 3040, 30.0)]
    assert recorder.nodes["Camera0"].initialControl.getLensPosition() == 120  # where the factory calibrated it
    assert recorder.calls[-1].method == "getChipTemperature"
    assert [call.method for call in recorder.calls if call.on in ("pipeline", "device")][-2] == "start"
    running.stop()
    assert [(call.on, call.method) for call in recorder.calls[-2:]] == [("pipeline", "stop"), ("device", "close")]


@pytest.mark.parametrize(
    ("changed", "options", "complaint"),
    [
        ({}, "?socket=CAM_D", "this OAK has no camera at CAM_D, but at CAM_A"),
        ({"focus": 0}, "", "its factory left no position: lock it with lens=0 to 255"),
    ],
)
def test_a_camera_that_does_not_fit_is_closed_again(
    dai: Any, changed: dict[str, Any], options: str, complaint: str
) -> None:
    recorder, asked = Recorder(dai, answers=answers(dai, **changed)), OakOptions.parse(options)
    with pytest.raises((DeviceError, UsageError), match=complaint):
        run(recorder.module(), "", lambda device: OakCamera.of(dai, device, asked), lambda *_: None)
    assert recorder.called("device", "close") == [()]


def test_a_camera_that_matches_is_backed_up_before_anything_is_built_and_nothing_is_flashed(
    dai: Any, plan: StereoPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = dict.fromkeys(("readCalibration", "readFactoryCalibration"), dai.CalibrationHandler())
    kept |= dict.fromkeys(("readCalibrationRaw", "readFactoryCalibrationRaw"), b"")
    recorder = Recorder(dai, answers=answers(dai) | kept)
    monkeypatch.setattr("prismstereo_device.sensors.oak.load_depthai", recorder.module)
    source = open_oak_stereo("?mode=stereo&lens=120", plan.calibration, backup_folder=tmp_path)
    source.close()
    done = [call.method for call in recorder.calls]
    assert done.index("readFactoryCalibrationRaw") < done.index("create") < done.index("start") < done.index("stop")
    assert len(list(tmp_path.glob("oak-18443010A1B2C3-*.json"))) == 1
    assert not [name for name in done if "flash" in name.lower()]
    other = replace(plan.calibration, lens_position=99)
    with pytest.raises(CalibrationError, match="locked at 120, but the calibration of 'oak-1' is for 99"):
        open_oak_stereo("?mode=stereo&lens=120", other, backup_folder=tmp_path)
    assert recorder.calls[-1].method == "close"


def test_where_there_is_no_camera_that_is_said_with_the_mend_and_nothing_else_is_printed() -> None:
    pytest.importorskip("depthai")
    program = (
        "import sys; from prismstereo_device.sensors.oak import open_oak; assert 'depthai' not in sys.modules\n"
        "try: open_oak('')\nexcept Exception as error: sys.stderr.write(f'{type(error).__name__}: {error}')"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("DEPTHAI_")}
    environment |= {"PYTHONPATH": os.pathsep.join(sys.path), "DEPTHAI_SEARCH_TIMEOUT": "100"}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, env=environment, timeout=60, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr.startswith(
        "DeviceError: an OAK camera is not there: check its cable (USB 3, no hub) and its power"
    )
    assert "udev rule for USB vendor 03e7" in done.stderr


def test_matching_on_the_camera_is_not_opened_as_a_sensor() -> None:
    with pytest.raises(UsageError, match="mode=stereo gives disparity in place of frames"):
        open_oak("?mode=stereo")
