"""Sessions of the optical twin in the paper's setting: a thing moves before a static background, stills come now and then.

Pictures are those of the left view as it is cut from the raw frame: the paper's lens has no distortion, so that video and still
differ by scale and shift alone, as rectified ones do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.models import Relief
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo_hw.modes import still_from_video
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Scene, named
from prismstereo_hw.sensor import SensorModel
from prismstereo_hw.shapes.box import Box
from prismstereo_hw.shapes.mesh import Mesh
from prismstereo_hw.shapes.pose import Motion
from prismstereo_hw.shapes.shape import Shape
from prismstereo_hw.shapes.stage import Stage
from prismstereo_hw.texture import Plain
from prismstereo_hw.twin import Truth, Twin

__all__ = ["FusionSession", "paper_setting", "scaled_rig"]

Picture = NDArray[np.uint8]
Points = NDArray[np.float64]


def scaled_rig(share: float = 1.0) -> Rig:
    """Return the paper's rig with video and stills of a share of their size each way."""
    rig = Rig.read("dslr-35mm")
    video, still = rig.camera.video, rig.camera.still
    camera = msgspec.structs.replace(
        rig.camera,
        video=Mode(width=2 * round(share * video.width / 2), height=round(share * video.height), rate_hz=video.rate_hz),
        still=Mode(width=2 * round(share * still.width / 2), height=round(share * still.height)),
    )
    return msgspec.structs.replace(rig, camera=camera)


@dataclass(frozen=True)
class FusionSession:
    """A scene before a rig; `moving` are the indices of the scene's surfaces that are not background."""

    rig: Rig
    scene: Scene
    moving: tuple[int, ...]
    exposure_us: float = 0.0  # of the video; 0: sharp
    noise: float = 1.5

    @cached_property
    def grid(self) -> Grid:
        """How the left view's video and still pixels go together."""
        scale, dx, dy = still_from_video(self.rig)
        low, high = (
            self.rig.views[0].rectangle(m.width, m.height) for m in (self.rig.camera.video, self.rig.camera.still)
        )
        return Grid(scale, scale, dx + scale * low[0] - high[0], dy + scale * low[1] - high[1])

    @cached_property
    def empty(self) -> FusionSession:
        """The same without the moving things."""
        rest = tuple(s for index, s in enumerate(self.scene.surfaces) if index not in self.moving)
        return replace(self, scene=replace(self.scene, surfaces=rest), moving=(), exposure_us=0.0)

    def video(self, seconds: float) -> Picture:
        """Return the left view of a video frame."""
        samples = 9 if self.exposure_us else 1
        sensor = SensorModel(
            exposure_us=self.exposure_us or 1000.0, reference_exposure_us=self.exposure_us or 1000.0, motion_samples=samples,
        )  # fmt: skip
        return self._cut(Twin(self.rig, self.scene, sensor=sensor, seed=7).frame(0, round(seconds * 1e6)).pixels)

    def still(self, seconds: float) -> Picture:
        """Return the left view of a still."""
        twin = Twin(self.rig, self.scene, mode=self.rig.camera.still, noise=self.noise, seed=11)
        return self._cut(twin.frame(0, round(seconds * 1e6)).pixels)

    def objects(self, seconds: float, *, still: bool = False, spinning: bool = False) -> NDArray[np.bool_]:
        """Tell which pixels of the left view show a moving thing; only those of wheels, which spin, if so asked."""
        shown = self._truth(seconds, still).objects
        chosen = [i for i in self.moving if not spinning or "wheel" in self.scene.surfaces[i].name]
        return np.isin(shown, [index + 1 for index in chosen])

    def relief(self, seconds: float) -> Relief:
        """Return the true disparity of the left view, and its camera."""
        lens, (x, y, _, _) = self.rig.lens(), self._rectangle(still=False)
        baseline_mm = 48.0
        disparity = lens.fx_px * baseline_mm / self._truth(seconds, still=False).depth_mm
        return Relief(disparity.astype(np.float32), lens.fx_px, lens.cx_px - x, lens.cy_px - y)

    def disparity_in_still(self, seconds: float) -> NDArray[np.float32]:
        """Return the true disparity at the still's resolution, still pixels, NaN where nothing is seen."""
        depth = self._truth(seconds, still=True).depth_mm
        return (self.rig.lens(self.rig.camera.still).fx_px * 48.0 / depth).astype(np.float32)

    def places(self, points: Points, at: float, then: float) -> Points:
        """Return where points (N, 2) of the video's left view at one time are at another; NaN where not seen then."""
        corner = np.array(self._rectangle(still=False)[:2], np.float64)
        view = sight(self.rig, "left")
        origin, direction = view.rays(self.rig.lens().slopes(points + corner))
        scene, other = self.scene.at(at), self.scene.at(then)
        reach, which = scene.first_hit(origin, direction)
        space = origin + np.where(np.isfinite(reach), reach, 0)[:, None] * direction
        moved = np.full_like(space, np.nan)
        for index in self.moving:
            here = which == index
            moved[here] = _carried(space[here], scene.surfaces[index], other.surfaces[index])
        slopes = view.slopes(moved)
        told = np.isfinite(slopes).all(axis=1)
        origin, direction = view.rays(slopes[told])
        reach, _ = other.first_hit(origin, direction)
        own = np.linalg.norm(moved[told] - origin, axis=1)
        slopes[told] = np.where((reach > 0.999 * own)[:, None], slopes[told], np.nan)
        return np.asarray(self.rig.lens().project_slopes(slopes) - corner)

    def _truth(self, seconds: float, still: bool) -> Truth:
        mode = self.rig.camera.still if still else self.rig.camera.video
        return Twin(self.rig, self.scene, mode=mode).truth(0, round(seconds * 1e6))

    def _rectangle(self, *, still: bool) -> tuple[int, int, int, int]:
        mode = self.rig.camera.still if still else self.rig.camera.video
        return self.rig.views[0].rectangle(mode.width, mode.height)

    def _cut(self, pixels: Picture) -> Picture:
        still = pixels.shape[0] == self.rig.camera.still.height
        x, y, w, h = self._rectangle(still=still)
        return np.ascontiguousarray(pixels[y : y + h, x : x + w])


def paper_setting(
    share: float = 1.0, *, seed: int = 1, exposure_us: float = 0.0, second: bool = False, pillar: bool = False,
    turn_deg_s: float = 0.0, plain: bool = False, swing: float = 0.15, shadow_rays: int = 4,
) -> FusionSession:  # fmt: skip
    """Return the paper's setting: a toy car over a static background, its shadow with it, the light slowly changing.

    `second` adds a box that goes the other way, `pillar` something at rest before the car, `turn_deg_s` lets the car's body
    turn about the vertical (out of the picture plane), `plain` takes the car's texture away.
    """
    rig = scaled_rig(share)
    scene = named(rig, "toy-car", seed)
    stage = Stage.before(rig)
    shapes = list(scene.surfaces)
    car, rest = shapes[:-2], shapes[-2:]
    if plain:
        car = [replace(part, texture=Plain(60.0 + 50 * number)) for number, part in enumerate(car)]
    if turn_deg_s:  # wheels would have to travel on circles: the body alone
        spin = stage.vector((0.0, turn_deg_s, 0.0))
        car = [replace(part, motion=Motion(part.motion.velocity_mm_s, spin)) for part in car[:1]]
    z = 1.35 * rig.range.near_mm
    half, middle = stage.half_width_mm(z), stage.middle_mm(z)
    if second:
        pose = stage.pose((middle + 0.35 * half, -0.45 * half, 1.05 * z))
        moving = Motion(stage.vector((-0.25 * half, 0.1 * half, 0.0)))
        car.append(Box("box", pose, (0.2 * half, 0.15 * half, 0.1 * half), stage.noise(seed + 20, z, 130.0), moving))
    if pillar:
        rest.insert(0, stage.facing("pillar", (middle + 0.1 * half, 0.0, 0.8 * z), (0.06 * half, 3 * half), seed + 30))
    light = scene.light and replace(scene.light, swing=swing, shadow_rays=shadow_rays)
    return FusionSession(
        rig, replace(scene, surfaces=(*car, *rest), light=light), tuple(range(len(car))), exposure_us=exposure_us
    )


def _carried(points: Points, here: Shape, there: Shape) -> Points:
    """Take points (N, 3) of a rigid body from where it is to where it will be."""
    assert isinstance(here, Box | Mesh)
    assert isinstance(there, Box | Mesh)
    return np.asarray(there.pose.direction_to_rig(here.pose.to_body(points)) + there.pose.centre_mm)
