"""Point clouds as LAS or LAZ files, by the packages laspy and lazrs (extra `las`).

Metres with z up, as programs for such files have it: x right, y ahead, z up of the left optical frame.
"""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from prismstereo.export.extras import extra_module

__all__ = ["las_bytes"]

_FINEST_M = 1e-5
_MOST_STEPS = 2_000_000_000  # coordinates are 32-bit numbers of steps
_PLAIN, _COLOURED = 0, 2  # point formats
_DEEP = 257  # from 8 to 16 bits


def las_bytes(
    points_m: NDArray[np.float32], colours: NDArray[np.uint8] | None = None, *, packed: bool = False
) -> bytes:
    """Return points (N, 3) of the optical frame, with colours (N, 3) RGB, as LAS 1.2; `packed` as LAZ.

    To ten micrometres, or to a two-thousand-millionth of the extent. UsageError where the packages are not installed.
    """
    laspy = extra_module("laspy", "las")
    if packed:
        extra_module("lazrs", "las")
    up = points_m.astype(np.float64)[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])
    extent = float(np.abs(up).max()) if len(up) else 0.0
    header = laspy.LasHeader(version="1.2", point_format=_PLAIN if colours is None else _COLOURED)
    header.scales = np.full(3, max(_FINEST_M, extent / _MOST_STEPS))
    header.offsets = np.zeros(3)
    header.system_identifier = "prismstereo"
    header.generating_software = "prismstereo"
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = up.T
    if colours is not None:
        cloud.red, cloud.green, cloud.blue = colours.astype(np.uint16).T * _DEEP
    content = io.BytesIO()
    cloud.write(content, do_compress=packed)
    return content.getvalue()
