"""The optics under watch: a look at them every some seconds, beside the stream, and what the looks say."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import zlib
from collections.abc import Callable
from concurrent.futures import Executor

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.objects import Held
from prismstereo_device.optics_health import OpticsHealth, take_look
from prismstereo_device.rectify import RectifiedPair
from prismstereo_device.state import Disk

__all__ = ["OpticsWatch"]

logger = logging.getLogger(__name__)

_PERIOD_S = 10.0
_FILE = "optics.json"
_REFERENCE_LOOKS = 9  # the first figures of a calibration are kept once so many looks agree on them


class _Reference(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a unit was like when this calibration was new, as a file."""

    calibration: str
    figures: dict[str, float]


class OpticsWatch:
    """Takes looks in `worker` and gives their report, JSON, to `keep`. What a calibration began with is kept on the disk.

    `due` and `look` are the frame loop's, `ask` anybody's.
    """

    def __init__(
        self, worker: Executor, disk: Disk, keep: Callable[[Held], None], *, period_s: float = _PERIOD_S
    ) -> None:
        self._worker, self._disk, self._put, self._period_s = worker, disk, keep, period_s
        self._due_s = time.monotonic() + period_s
        self._busy = threading.Event()
        self._health: OpticsHealth | None = None
        self._of: tuple[str, tuple[int, ...]] | None = None
        self._looks = 0
        self._kept = True

    def ask(self) -> bool:
        """Look at the next frame already; False while a look is being taken."""
        self._due_s = 0.0
        return not self._busy.is_set()

    def due(self) -> bool:
        """Tell whether the next frame should be looked at."""
        return time.monotonic() >= self._due_s and not self._busy.is_set()

    def look(
        self, calibration_hash: bytes, raw: NDArray[np.uint8], pair: RectifiedPair, disparity: DisparityMap | None
    ) -> None:
        """Look at a frame: the raw one, (height, width[, 3]), its rectified pair, and its map where it was matched."""
        self._due_s = time.monotonic() + self._period_s
        self._busy.set()
        self._worker.submit(self._take, calibration_hash.hex(), raw, pair, disparity)

    def _take(
        self, calibration: str, raw: NDArray[np.uint8], pair: RectifiedPair, disparity: DisparityMap | None
    ) -> None:
        try:
            health = self._health_of(calibration, (*pair.left.shape, raw.shape[1]))
            health.add(take_look(raw, pair, health.reference.get("seam_px")), pair, disparity)
            self._looks += 1
            if not self._kept and self._looks >= _REFERENCE_LOOKS:
                self._kept = True
                self._keep(_Reference(calibration, health.reference))
            told = health.report()
            for finding in told.findings:
                if finding.state == "warn":
                    logger.warning("optics: %s is %.3g: %s", finding.name, finding.value, finding.mend)
            content = msgspec.json.encode(told.as_json())
            self._put(Held(zlib.crc32(content) or 1, content))
        finally:
            self._busy.clear()

    def _health_of(self, calibration: str, size: tuple[int, ...]) -> OpticsHealth:
        """Give what gathers the looks of this calibration; another one begins anew."""
        if self._health is None or self._of != (calibration, size):
            known = self._known(calibration)
            height, width, frame_width = size
            self._health = OpticsHealth(width, height, frame_width, known)
            self._of, self._looks, self._kept = (calibration, size), 0, known is not None
        return self._health

    def _known(self, calibration: str) -> dict[str, float] | None:
        with contextlib.suppress(OSError, msgspec.DecodeError):
            found = msgspec.json.decode(self._disk.read(_FILE), type=_Reference)
            if found.calibration == calibration:
                return found.figures
        return None

    def _keep(self, reference: _Reference) -> None:
        new = f"{_FILE}.new"
        try:
            self._disk.write(new, msgspec.json.encode(reference))
            self._disk.sync(new)
            self._disk.rename(new, _FILE)
            self._disk.sync_folder()
        except OSError:
            logger.exception("what the optics are like now could not be kept: a restart learns it anew")
