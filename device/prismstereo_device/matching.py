"""The pipeline in force, and its changes: another calibration, another matcher, another region, reasons or none.

A matcher that has to be compiled first is compiled beside the stream, which goes on with the one before until then.
"""

from __future__ import annotations

import threading

import msgspec

from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device import match
from prismstereo_device.control.settings import AUTO, Settings
from prismstereo_device.filters import PRESETS, FilterChain
from prismstereo_device.match import MatchSettings
from prismstereo_device.pipeline import Pipeline
from prismstereo_device.zones import ZoneFinder
from prismstereo_hw.errors import UsageError

__all__ = ["OWN_FILTERS", "Matching", "filter_set"]

OWN_FILTERS = 127  # filters from a file: their numbers are told by the identity object alone


def filter_set(filters: str | None) -> int:
    """Give the number of the filters for the frame's head: 0 none, 1.. the presets in their order, 127 a file's own."""
    if filters is None:
        return 0
    return PRESETS.index(filters) + 1 if filters in PRESETS else OWN_FILTERS


class Matching:
    """Makes and remakes the pipeline; changed by the frame loop alone.

    `calibration` is flash bytes. Raises DataError where these are none, UsageError where they or the settings cannot be had;
    then what was in force stays so.
    """

    def __init__(self, calibration: bytes, settings: Settings, *, filters: FilterChain | None = None) -> None:
        self._filters = filters
        self._chosen = _choice(settings)
        self._compiling: tuple[Settings, threading.Thread] | None = None
        self.calibrate(calibration)

    @property
    def pipeline(self) -> Pipeline:
        """What matches the next frame."""
        return self._pipeline

    @property
    def calibration(self) -> Calibration:
        """The calibration in force."""
        return self._pipeline.calibration

    @property
    def calibration_hash(self) -> bytes:
        """Eight bytes that name the calibration in force."""
        return self._hash

    @property
    def picture(self) -> tuple[int, int]:
        """Width and height of the rectified pictures."""
        made = self._pipeline.rectifier.rectification
        return made.width, made.height

    @property
    def chosen(self) -> Settings:
        """The matcher, region and reasons in force; a calibration with smaller pictures sets the region back to all of them."""
        return self._chosen

    @property
    def zones(self) -> ZoneFinder:
        """What finds the zones of the maps."""
        return ZoneFinder(self._pipeline.rectifier.rectification)

    @property
    def labels(self) -> int:
        """How many disparities are searched."""
        return self._pipeline.rectifier.rectification.window.labels

    def calibrate(self, content: bytes) -> None:
        """Go on with another calibration, or with the old one where this raises."""
        pipeline = Pipeline(
            flash.unpack(content), _matcher(self._chosen), filters=self._filters, explain=self._chosen.reasons
        )
        self._pipeline, self._hash = pipeline, flash.digest(content)
        if not _inside(self._chosen.region, *self.picture):
            self._use(msgspec.structs.replace(self._chosen, region=AUTO))

    def choose(self, settings: Settings) -> None:
        """Go on with these settings' matcher, region and reasons, as soon as what has to be compiled is."""
        wished = _choice(settings)
        if self._compiling is not None and wished == self._compiling[0]:
            return
        self._compiling = None
        if wished == self._chosen:
            return
        self._require_inside(wished)
        compiler = None if wished.matcher == self._chosen.matcher else match.warm_up(wished.matcher, self.labels)
        if compiler is None:
            self._use(wished)
        else:
            self._compiling = wished, compiler

    def advance(self) -> None:
        """Go over to what was chosen once it is compiled; called between two frames."""
        if self._compiling is not None and not self._compiling[1].is_alive():
            wished, self._compiling = self._compiling[0], None
            self._use(wished)

    def _require_inside(self, wished: Settings) -> None:
        width, height = self.picture
        if not _inside(wished.region, width, height):
            raise UsageError(
                f"region {wished.region} leaves the rectified picture of {width}x{height}: give one inside"
            )

    def _use(self, wished: Settings) -> None:
        self._require_inside(wished)
        self._pipeline = self._pipeline.with_matcher(_matcher(wished), explain=wished.reasons)
        self._chosen = wished


def _choice(settings: Settings) -> Settings:
    """Give the settings that a pipeline is made by, and nothing else of them."""
    return Settings(matcher=settings.matcher, region=settings.region, reasons=settings.reasons)


def _matcher(chosen: Settings) -> match.Matcher:
    region = None if isinstance(chosen.region, str) else chosen.region
    return match.create(chosen.matcher, MatchSettings(region=region))


def _inside(region: tuple[int, int, int, int] | str, width: int, height: int) -> bool:
    if isinstance(region, str):
        return True
    x, y, w, h = region
    return x + w <= width and y + h <= height
