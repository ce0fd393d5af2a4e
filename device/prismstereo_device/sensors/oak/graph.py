"""What runs on the camera, as a graph of depthai nodes.

    capture     Camera -> frames                          Camera, full resolution -> Gate -> stills
    stereo      Camera -> per view: crop -> warp by our mesh -> new instance number -> StereoDepth, not rectifying -> disparity

Both views come from one socket, and StereoDepth looks a pair up by the instance numbers of its frames: with equal ones it
fails (depthai-core #815). So a script on the camera gives each view the number of its virtual socket. Where depthai could
change a calibration by itself, it is told not to.

`dai` is the depthai module, `pipeline` one of its pipelines: what checks a graph without a camera takes that one's place.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

from prismstereo_device.sensors.oak.calibration_handover import LEFT_SOCKET, RIGHT_SOCKET
from prismstereo_device.sensors.oak.mesh import ViewMesh
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_device.sensors.oak.stereo_settings import StereoSettings

__all__ = ["CapturePorts", "StereoPorts", "capture_graph", "cut_view", "stereo_graph"]

_ALIGNED_WIDTH_PX, _ALIGNED_HEIGHT_PX = 256, 64  # depthai pads the pictures that it makes, by less than this
_QUEUED = 2  # frames that wait for a slow reader: the newest ones
_RENUMBER = """
while True:
    frame = node.inputs['in'].get()
    frame.setInstanceNum({number})
    node.outputs['out'].send(frame)
"""


@dataclass(frozen=True, slots=True)
class CapturePorts:
    """Queues to and from a running capture graph; `stills` and `gate` None where no stills were asked for."""

    frames: Any
    control: Any
    stills: Any | None = None
    gate: Any | None = None


@dataclass(frozen=True, slots=True)
class StereoPorts:
    """Queues to and from a running stereo graph; None for what was not asked for."""

    disparity: Any
    control: Any
    confidence: Any | None = None
    preview: Any | None = None


def capture_graph(dai: ModuleType, pipeline: Any, options: OakOptions, *, focus: int | None) -> CapturePorts:
    """Build the capture graph; `focus` is where the lens is locked, None for a lens without a motor."""
    camera = _camera(dai, pipeline, options, focus)
    video = _frames(
        dai, camera, options, dai.ImgFrame.Type.NV12 if options.pixels == "nv12" else dai.ImgFrame.Type.GRAY8
    )
    frames = video.createOutputQueue(maxSize=_QUEUED, blocking=False)
    control = camera.inputControl.createInputQueue(maxSize=4, blocking=False)
    if not options.stills:
        return CapturePorts(frames, control)
    gate = _node(dai, pipeline, dai.node.Gate)
    gate.initialConfig.open = False
    full = camera.requestFullResolutionOutput(type=dai.ImgFrame.Type.NV12, fps=options.rate_hz)
    full.link(gate.input)
    stills = gate.output.createOutputQueue(maxSize=1, blocking=False)
    return CapturePorts(frames, control, stills, gate.inputControl.createInputQueue(maxSize=1, blocking=False))


def stereo_graph(
    dai: ModuleType,
    pipeline: Any,
    options: OakOptions,
    meshes: tuple[ViewMesh, ViewMesh],
    size: tuple[int, int],
    handler: Any,
    *,
    focus: int | None,
) -> StereoPorts:
    """Build the stereo graph: meshes of the left and the right view, width and height of the rectified pictures.

    `handler` is handed to the pipeline for this run. The same graph runs on RVC2 and RVC4: neither output size nor aspect
    ratio is set, which RVC4 refuses, and the input size always is, which RVC2 needs.
    """
    camera = _camera(dai, pipeline, options, focus)
    pipeline.setCalibrationData(handler)
    video = _frames(dai, camera, options, dai.ImgFrame.Type.GRAY8)
    stereo = _node(dai, pipeline, dai.node.StereoDepth)
    for mesh, number, into in zip(meshes, (LEFT_SOCKET, RIGHT_SOCKET), (stereo.left, stereo.right), strict=True):
        crop = _node(dai, pipeline, dai.node.ImageManip)
        cut_view(dai, crop, mesh)
        video.link(crop.inputImage)
        warp = _node(dai, pipeline, dai.node.Warp)
        _warp_view(dai, warp, mesh, size)
        crop.out.link(warp.inputImage)
        script = _node(dai, pipeline, dai.node.Script)
        script.setScript(_RENUMBER.format(number=number))
        warp.out.link(script.inputs["in"])
        script.outputs["out"].link(into)
    _set_stereo(dai, stereo, options.stereo, size)
    return _stereo_ports(camera, stereo, options.stereo)


def _camera(dai: ModuleType, pipeline: Any, options: OakOptions, focus: int | None) -> Any:
    pipeline.setAutoCalibrationMode(dai.Pipeline.AutoCalibrationMode.OFF)
    camera = _node(dai, pipeline, dai.node.Camera).build(
        boardSocket=getattr(dai.CameraBoardSocket, options.socket), sensorFps=options.rate_hz
    )
    if focus is not None:  # a calibration belongs to one focus
        camera.initialControl.setAutoFocusMode(dai.CameraControl.AutoFocusMode.OFF)
        camera.initialControl.setManualFocus(focus)
    return camera


def _frames(dai: ModuleType, camera: Any, options: OakOptions, pixel_type: Any) -> Any:
    """Ask for the whole frame as it is: what the lens bends is our calibration's to know."""
    return camera.requestOutput(
        (options.width, options.height),
        type=pixel_type,
        resizeMode=dai.ImgResizeMode.CROP,
        fps=options.rate_hz,
        enableUndistortion=False,
    )


def cut_view(dai: ModuleType, crop: Any, mesh: ViewMesh) -> None:
    """Let an ImageManip node cut a view out of the frame, grey."""
    _, _, width, height = mesh.crop
    crop.initialConfig.addCrop(*mesh.crop)
    crop.initialConfig.setFrameType(dai.ImgFrame.Type.GRAY8)
    crop.setMaxOutputFrameSize(_most_bytes(width, height))


def _warp_view(dai: ModuleType, warp: Any, mesh: ViewMesh, size: tuple[int, int]) -> None:
    warp.setWarpMesh(mesh.points(), mesh.columns, mesh.rows)
    warp.setOutputSize(size)
    warp.setMaxOutputFrameSize(_most_bytes(*size))
    warp.setInterpolation(dai.Interpolation.BILINEAR)


def _most_bytes(width: int, height: int) -> int:
    """Return the room for a grey picture, padding included."""
    return -(-width // _ALIGNED_WIDTH_PX) * _ALIGNED_WIDTH_PX * -(-height // _ALIGNED_HEIGHT_PX) * _ALIGNED_HEIGHT_PX


def _node(dai: ModuleType, pipeline: Any, kind: Any) -> Any:
    """Make a node that keeps quiet: nodes print to standard output, where ours is read by programs."""
    node = pipeline.create(kind)
    node.setLogLevel(dai.LogLevel.OFF)
    return node


def _set_stereo(dai: ModuleType, stereo: Any, settings: StereoSettings, size: tuple[int, int]) -> None:
    stereo.setRectification(False)  # what arrives is rectified
    stereo.setInputResolution(*size)
    stereo.setLeftRightCheck(True)
    stereo.setSubpixel(True)
    stereo.setSubpixelFractionalBits(settings.bits)
    stereo.setExtendedDisparity(settings.extended)
    stereo.setDepthAlign(dai.StereoDepthConfig.AlgorithmControl.DepthAlign.RECTIFIED_LEFT)
    config = stereo.initialConfig
    config.setDisparityShift(settings.shift_px)
    config.setConfidenceThreshold(settings.threshold)
    config.setNumInvalidateEdgePixels(0)
    kernel = "MEDIAN_OFF" if settings.median == "off" else f"KERNEL_{settings.median}x{settings.median}"
    config.setMedianFilter(getattr(dai.MedianFilter, kernel))
    _fill_nothing(config.postProcessing)


def _fill_nothing(after: Any) -> None:
    """Switch off what would smooth, shrink or fill: unmatched stays unmatched, and filters are ours. Some are on by default."""
    after.decimationFilter.decimationFactor = 1
    after.speckleFilter.enable = False
    after.spatialFilter.enable = False
    after.temporalFilter.enable = False
    after.holeFilling.enable = False
    after.adaptiveMedianFilter.enable = False


def _stereo_ports(camera: Any, stereo: Any, settings: StereoSettings) -> StereoPorts:
    def queue(output: Any) -> Any:
        return output.createOutputQueue(maxSize=_QUEUED, blocking=False)

    return StereoPorts(
        disparity=queue(stereo.disparity),
        control=camera.inputControl.createInputQueue(maxSize=4, blocking=False),
        confidence=queue(stereo.confidenceMap) if settings.confidence else None,
        preview=queue(stereo.syncedLeft) if settings.preview else None,
    )
