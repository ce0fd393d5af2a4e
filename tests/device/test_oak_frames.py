"""What comes from an OAK camera, through depthai's own messages and queues: frames, stills, disparity, and it coming back."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.sensors.base import Exposure, StampQuality
from prismstereo_device.sensors.oak.capture import OakCapture
from prismstereo_device.sensors.oak.frame_reading import OutputPlace
from prismstereo_device.sensors.oak.graph import CapturePorts, StereoPorts, cut_view
from prismstereo_device.sensors.oak.library import load_depthai
from prismstereo_device.sensors.oak.on_device_stereo import OakStereoSource, StereoPlan
from prismstereo_device.sensors.oak.opening import OakCamera, Running
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_hw.errors import DeviceError, UsageError
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin

CAMERA = OakCamera("RVC2", "18443010A1B2C3", (), has_motor=True, focus=130)


@pytest.fixture(scope="module")
def dai() -> Any:
    pytest.importorskip("depthai")
    return load_depthai()


def message(dai: Any, number: int, pixels: NDArray[Any], kind: str = "NV12", exposure_us: int = 10_000) -> Any:
    """A frame as the camera sends it, complete `number` / 30 s after a minute."""
    made = dai.ImgFrame()
    made.setCvFrame(pixels, getattr(dai.ImgFrame.Type, kind))
    made.setSequenceNum(number)
    made.setTimestamp(dt.timedelta(seconds=60, microseconds=round(number * 1e6 / 30)))
    made.cam.exposureTimeUs, made.cam.sensitivityIso, made.cam.lensPosition = exposure_us, 400, 130
    return made


def shown(dai: Any, frame: Any, crop: tuple[int, int, int, int]) -> Any:
    """The frame, with the word that it shows this rectangle of a sensor of 4056x3040 pixels."""
    x, y, width, height = crop
    way = dai.ImgTransformation(4056, 3040, 4056, 3040).addCrop(x, y, width, height)
    frame.setTransformation(way.addScale(frame.getWidth() / width, frame.getHeight() / height))
    return frame


@dataclass
class Queues:
    """A camera made of depthai's own queues, and how often it was started."""

    dai: Any
    started: list[CapturePorts] = field(default_factory=list)
    fails: list[Exception] = field(default_factory=list)
    sent_when_back: tuple[int, ...] = ()
    camera: OakCamera = CAMERA
    chip_c: float = 41.5

    def begin(self) -> Running[CapturePorts]:
        if self.started and self.fails:
            raise self.fails.pop(0)
        queues = [self.dai.MessageQueue(maxSize=16, blocking=False) for _ in range(4)]
        self.started.append(CapturePorts(*queues))
        if len(self.started) > 1:
            self.sends(*self.sent_when_back)
        return Running(self.started[-1], self.camera, lambda: self.chip_c, lambda: None)

    def sensor(self, **options: Any) -> OakCapture:
        timing = {name: options.pop(name) for name in ("frames", "patience_s", "silent_s") if name in options}
        return OakCapture(self.dai, self.begin, OakOptions(**options), **timing)

    def sends(self, *numbers: int) -> None:
        for number in numbers:
            self.started[-1].frames.send(message(self.dai, number, np.full((72, 128, 3), 90, np.uint8)))


@pytest.fixture
def camera(dai: Any) -> Queues:
    return Queues(dai)


# ---- frames


def test_a_frame_has_its_pixels_its_number_its_focus_and_the_time_of_mid_exposure(dai: Any, camera: Queues) -> None:
    sensor = camera.sensor(frames=1)
    picture = np.zeros((72, 128, 3), np.uint8)
    picture[:, 64:] = (200, 90, 30)  # BGR
    camera.started[0].frames.send(shown(dai, message(dai, 30, picture), (0, 379, 4056, 2282)))
    frame = sensor.read()
    assert frame is not None
    assert (frame.index, frame.timestamp_us, frame.lens_position) == (30, 60_995_000, 130)  # 5 ms before its end
    assert np.abs(frame.pixels.astype(int) - picture)[:, :62].max() <= 3
    assert np.abs(frame.pixels.astype(int) - picture)[:, 66:].max() <= 3
    assert sensor.place is not None
    np.testing.assert_allclose(sensor.place.crop, (0, 379, 4056, 2282), atol=0.01)
    assert (sensor.read(), sensor.stamp_quality, sensor.temperature_c) == (None, StampQuality.EXPOSURE, 41.5)


def test_grey_frames_stay_grey_and_a_lens_without_a_motor_tells_no_position(dai: Any, rng: np.random.Generator) -> None:
    camera = Queues(dai, camera=replace(CAMERA, has_motor=False, focus=None))
    sensor, picture = camera.sensor(pixels="gray8"), rng.integers(0, 256, (72, 128), np.uint8)
    camera.started[0].frames.send(message(dai, 7, picture, "GRAY8"))
    frame = sensor.read()
    assert frame is not None
    np.testing.assert_array_equal(frame.pixels, picture)
    assert frame.lens_position is None
    with pytest.raises(UsageError, match="lens position 100: this OAK's lens has no motor"):
        sensor.set_lens(100)


def test_a_still_is_registered_to_the_video_by_what_both_show_of_the_sensor() -> None:
    video = OutputPlace((0.0, 379.0, 4056.0, 2281.5), 1280, 720)
    still = OutputPlace((12.0, 8.0, 4032.0, 3024.0), 4032, 3024).as_output("still", video)
    sensor = np.array([[0.0, 379.0], [4056.0, 2660.5]])  # corners of the video, from the sensor's corner
    corners = np.array([[-0.5, -0.5], [1279.5, 719.5]])  # in pixels, from their centres
    np.testing.assert_allclose(still.from_calibrated(corners), sensor - [12.0, 8.0] - 0.5, atol=1e-6)


# ---- what is set


def test_exposure_and_gain_are_sent_as_the_camera_counts_them(dai: Any, camera: Queues) -> None:
    sensor = camera.sensor()
    sensor.set_exposure(Exposure(exposure_us=5000, gain=2.5))
    sent = camera.started[0].control.get()
    assert (sent.expManual.exposureTimeUs, sent.expManual.sensitivityIso) == (5000, 250)
    assert sent.getCommand(dai.CameraControl.Command.AE_MANUAL)
    sensor.set_exposure(Exposure())
    assert camera.started[0].control.get().getCommand(dai.CameraControl.Command.AE_AUTO)
    sensor.set_lens(77)
    assert camera.started[0].control.get().getLensPosition() == 77


def test_half_an_exposure_leaves_the_other_half_as_the_automatic_had_it(dai: Any, camera: Queues) -> None:
    sensor = camera.sensor()
    camera.started[0].frames.send(message(dai, 0, np.zeros((72, 128, 3), np.uint8), exposure_us=8000))
    sensor.read()
    sensor.set_exposure(Exposure(gain=8.0))
    sent = camera.started[0].control.get().expManual
    assert (sent.exposureTimeUs, sent.sensitivityIso) == (8000, 800)
    sensor.set_exposure(Exposure(exposure_us=3000))
    sent = camera.started[0].control.get().expManual
    assert (sent.exposureTimeUs, sent.sensitivityIso) == (3000, 400)


@pytest.mark.parametrize(
    ("wish", "complaint"),
    [
        (Exposure(exposure_us=40_000, gain=1.0), "exposure_us 40000: at this rate the camera takes 1 to 33333"),
        (Exposure(exposure_us=100, gain=17.0), "gain 17: at this rate the camera takes 1 to 16"),
    ],
)
def test_an_exposure_beyond_the_limits_is_refused_and_nothing_is_sent(
    camera: Queues, wish: Exposure, complaint: str
) -> None:
    sensor = camera.sensor()
    with pytest.raises(UsageError, match=complaint):
        sensor.set_exposure(wish)
    with pytest.raises(UsageError, match="lens position 256: give 0 to 255"):
        sensor.set_lens(256)
    with pytest.raises(UsageError, match="a rate of 60 Hz: give up to the rate that the camera was opened with"):
        sensor.set_rate(60.0)
    assert not camera.started[0].control.has()


def test_a_lower_rate_gives_every_second_frame(camera: Queues) -> None:
    sensor = camera.sensor(frames=4)
    sensor.set_rate(15.0)
    camera.sends(*range(8))
    assert [frame.index for frame in iter(sensor.read, None)] == [0, 2, 4, 6]


# ---- stills


def test_a_still_opens_the_gate_for_one_frame_and_has_the_number_of_the_exposure(dai: Any, camera: Queues) -> None:
    sensor = camera.sensor()
    ports = camera.started[0]
    full = shown(dai, message(dai, 12, np.full((304, 404, 3), 120, np.uint8)), (12, 8, 4032, 3024))
    ports.stills.send(message(dai, 3, np.zeros((304, 404, 3), np.uint8)))  # too late for an earlier request
    ports.gate.addCallback(lambda: ports.stills.send(full))
    still = sensor.still()
    assert (still.frame.index, still.frame.width, still.crop) == (12, 404, (12, 8, 4032, 3024))
    opened = ports.gate.get()
    assert (opened.open, opened.numMessages) == (True, 1)
    with pytest.raises(UsageError, match="opened without stills"):
        OakCapture(
            dai, lambda: Running(CapturePorts(None, None), CAMERA, lambda: None, lambda: None), OakOptions()
        ).still()


# ---- a camera that goes away and comes back


def test_a_camera_that_comes_back_goes_on_with_its_numbers_and_its_settings(camera: Queues) -> None:
    sensor = camera.sensor()
    sensor.set_exposure(Exposure(exposure_us=5000, gain=2.0))
    sensor.set_lens(99)
    camera.sends(40, 41)
    assert [frame.index for frame in (sensor.read(), sensor.read()) if frame] == [40, 41]
    camera.sent_when_back = (0, 1)
    camera.started[0].frames.close()
    assert [frame.index for frame in (sensor.read(), sensor.read()) if frame] == [42, 43]
    assert len(camera.started) == 2
    assert camera.started[1].control.get().expManual.exposureTimeUs == 5000
    assert camera.started[1].control.get().getLensPosition() == 99


def test_a_damaged_frame_is_passed_over_and_counted(dai: Any, camera: Queues) -> None:
    sensor = camera.sensor()
    camera.started[0].frames.send(dai.ImgFrame())
    camera.sends(9)
    frame = sensor.read()
    assert frame is not None
    assert (frame.index, sensor.damaged) == (9, 1)


def test_a_camera_that_stays_away_is_an_error_after_patience(camera: Queues) -> None:
    sensor = camera.sensor(patience_s=0.0, silent_s=0.05)
    camera.fails = [DeviceError("an OAK camera is not there")]
    with pytest.raises(DeviceError, match="went away and did not come back: an OAK camera is not there"):
        sensor.read()
    sensor.close()


# ---- disparity from the camera


def through_the_graph(dai: Any, plan: StereoPlan, frame: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Both rectified pictures: cut out by depthai's own node, which runs here too, and warped by the mesh."""
    pictures = []
    for mesh in plan.meshes:
        pipeline = dai.Pipeline(createImplicitDevice=False)
        crop = pipeline.create(dai.node.ImageManip)
        crop.setRunOnHost(True)
        cut_view(dai, crop, mesh)
        into, out = crop.inputImage.createInputQueue(), crop.out.createOutputQueue()
        pipeline.start()
        into.send(message(dai, 5, frame, "GRAY8"))
        cut = out.get(dt.timedelta(seconds=10))
        pipeline.stop()
        pipeline.wait()
        assert cut.getSequenceNum() == 5
        pictures.append(cv2.remap(cut.getCvFrame(), mesh.dense(), None, cv2.INTER_LINEAR))
    return pictures


def stereo(dai: Any, plan: StereoPlan, options: OakOptions) -> tuple[OakStereoSource, StereoPorts]:
    ports = StereoPorts(*(dai.MessageQueue(maxSize=16, blocking=False) for _ in range(4)))
    return OakStereoSource(
        dai, lambda: Running(ports, CAMERA, lambda: 50.0, lambda: None), options, plan, patience_s=0.0, silent_s=0.05
    ), ports


def test_a_plane_comes_back_at_its_distance_through_crop_mesh_and_the_engines_numbers(dai: Any, oak: Rig) -> None:
    options = OakOptions.parse("?mode=stereo&width=192&height=96&bits=4")
    video = Mode(width=192, height=96, rate_hz=30.0)
    small = msgspec.structs.replace(oak, camera=msgspec.structs.replace(oak.camera, video=video))
    nominal = Calibration.nominal(small)
    plan = StereoPlan.of(nominal, options)
    view, window = fold(small, "left"), plan.made.window
    depth_mm = window.scale_px / (12 + window.offset_px)  # a whole disparity: what matches here rounds towards those
    pinhole_z_mm = (view.paraxial_centre_mm + nominal.nearest_pinholes().shift * view.R[2])[2]
    frame = Twin(small, facing_plane(small, depth_mm + pinhole_z_mm)).frame().pixels
    grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    left, right = (cv2.copyMakeBorder(view, 0, 0, 96, 0, 0) for view in through_the_graph(dai, plan, grey))
    matched = cv2.StereoSGBM.create(0, 96, 5, 200, 800, 1, uniquenessRatio=10).compute(left, right)[:, 96:]
    source, ports = stereo(dai, plan, options)
    ports.disparity.send(message(dai, 5, np.maximum(matched, 0).astype(np.uint16), "RAW16"))
    ports.preview.send(message(dai, 5, np.ascontiguousarray(left[:, 96:]), "GRAY8"))
    produced = source.read()
    assert produced is not None
    assert produced.disparity is not None
    assert np.nanmedian(produced.disparity.depth()) == pytest.approx(depth_mm, rel=0.01)  # 1/16 px: 0.6 %
    assert (produced.index, produced.timestamp_us, produced.lens_position) == (5, 60_161_667, 130)
    assert produced.calibration_hash == flash.digest(flash.pack(nominal))
    np.testing.assert_array_equal(produced.preview, left[:, 96:])


@pytest.fixture(scope="module")
def small_plan(small: Rig) -> StereoPlan:
    return StereoPlan.of(Calibration.nominal(small), OakOptions(width=320, height=180))


def test_maps_of_other_exposures_are_passed_over(dai: Any, small_plan: StereoPlan) -> None:
    source, ports = stereo(dai, small_plan, OakOptions())
    height, width = small_plan.seen().shape
    for number in (3, 4, 5):
        ports.confidence.send(message(dai, number, np.full((height, width), 10 * number, np.uint8), "GRAY8"))
    ports.preview.send(message(dai, 9, np.zeros((height, width), np.uint8), "GRAY8"))
    ports.disparity.send(message(dai, 5, np.full((height, width), 320, np.uint16), "RAW16"))
    produced = source.read()
    assert produced is not None
    assert produced.disparity is not None
    assert produced.disparity.confidence is not None
    assert set(np.unique(produced.disparity.confidence)) == {0, 50}
    assert np.nanmax(produced.disparity.disparity_px) == 20.0
    assert produced.preview is None


@pytest.mark.parametrize(("shape", "kind"), [((90, 80), np.uint16), ((180, 160), np.uint8)])
def test_disparities_of_another_form_are_refused(
    dai: Any, small_plan: StereoPlan, shape: tuple[int, int], kind: Callable[..., Any]
) -> None:
    source, ports = stereo(dai, small_plan, OakOptions())
    ports.disparity.send(message(dai, 1, np.zeros(shape, kind), "RAW16" if kind is np.uint16 else "GRAY8"))
    with pytest.raises(DeviceError, match=r"but \(180, 160\) in 16 bits were asked for: update depthai"):
        source.read()
