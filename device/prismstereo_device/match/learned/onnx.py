"""The learned matcher: a stereo network from an ONNX file behind the matcher interface."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.base import Found, Grey, Matcher, Search
from prismstereo_device.match.learned.disparity_output import disparity_map
from prismstereo_device.match.learned.fitting import Fitting
from prismstereo_device.match.learned.model_shape import ModelShape
from prismstereo_device.match.learned.request import Request
from prismstereo_device.match.learned.session import Session
from prismstereo_device.match.learned.tensors import tensors
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.reasons import Reason
from prismstereo_hw.errors import UsageError

__all__ = ["OnnxMatcher"]

logger = logging.getLogger(__name__)

_CONSISTENT_PX = 1.0
_AS_USUAL = MatchSettings()
Float = NDArray[np.float32]


class OnnxMatcher(Matcher):
    """Runs a network on the pair, and with `check` on the mirrored pair too.

    A network gives every pixel a disparity: what is not a number, or outside of the searched range, is unmatched, and with
    `check` so is what the right view contradicts.
    """

    def __init__(self, request: Request, settings: MatchSettings = _AS_USUAL) -> None:
        """Open the model and see how it takes a pair; `DataError` where it does not fit, `UsageError` for the request."""
        super().__init__(settings)
        self._request = request
        self._session = Session(request.path, request.providers, settings.threads)
        ports = (*self._session.inputs, *self._session.outputs)
        self._convention = request.convention(port.name for port in ports)
        self._shape = ModelShape.of(self._session.inputs, self._session.outputs, self._convention, str(request.path))

    @classmethod
    def named(cls, name: str, settings: MatchSettings = _AS_USUAL) -> OnnxMatcher:
        """Make the matcher of a name `onnx:MODEL.onnx[,option=value]...`."""
        return cls(Request.parse(name), settings)

    def search(self, left: Grey, right: Grey, search: Search) -> Found:
        """Search grey pictures (height, width)."""
        fitting = Fitting.plan(left.shape[0], left.shape[1], self._shape, self._convention)
        self._require_reach(search, fitting)
        disparity = self._run(left, right, fitting)
        reasons = np.full(left.shape, Reason.MATCHED, np.uint8)
        if self._request.check:
            other = self._run(_mirrored(right), _mirrored(left), fitting)[:, ::-1]
            reasons[~_agree(disparity, other)] = Reason.OCCLUDED
        with np.errstate(invalid="ignore"):
            reasons[disparity < search.first] = Reason.TOO_FAR  # below 0 would lie behind infinity
            reasons[disparity > search.labels - 1] = Reason.TOO_NEAR
        reasons[~np.isfinite(disparity)] = Reason.UNMATCHED
        return Found(np.where(reasons == Reason.MATCHED, disparity, np.float32(np.nan)), reasons=reasons)

    def _run(self, left: Grey, right: Grey, fitting: Fitting) -> Float:
        """Return the disparity (height, width) float32 of the first picture, in its pixels, as the network has it."""
        origin = str(self._request.path)
        pictures = fitting.picture(left), fitting.picture(right)
        inputs = tensors(*pictures, self._shape, self._convention, origin)
        output = self._session.run(inputs, self._shape.output.name)
        return fitting.disparity(
            disparity_map(output, fitting.model_height, fitting.model_width, self._convention, origin)
        )

    def _require_reach(self, search: Search, fitting: Fitting) -> None:
        reach_px = self._convention.max_disparity * fitting.magnification
        if not reach_px:
            return
        if search.first >= reach_px:
            raise UsageError(
                f"the search begins at {search.first} px, but {self._request.path} finds at most {reach_px:.0f} px: begin below"
            )
        if search.labels - 1 > reach_px:
            logger.info("%s finds at most %.0f of %d px", self._request.path, reach_px, search.labels - 1)


def _mirrored(picture: Grey) -> Grey:
    return np.ascontiguousarray(picture[:, ::-1])


def _agree(disparity: Float, other: Float) -> NDArray[np.bool_]:
    """Tell where the right view's disparity (height, width) at the partner is the same within a pixel."""
    columns = np.arange(disparity.shape[1], dtype=np.float32)
    with np.errstate(invalid="ignore"):
        partner = np.rint(columns - disparity)
        inside = (partner >= 0) & (partner < disparity.shape[1])
        back = np.take_along_axis(other, np.where(inside, partner, 0).astype(np.intp), axis=1)
        return np.asarray(inside & (np.abs(back - disparity) <= _CONSISTENT_PX))
