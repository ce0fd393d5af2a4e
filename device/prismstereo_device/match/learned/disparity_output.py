"""The disparity map in what a model gives back, whatever axes it put around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.learned.convention import Convention
from prismstereo_hw.errors import DataError

__all__ = ["disparity_map"]


def disparity_map(
    output: NDArray[np.generic], height: int, width: int, convention: Convention, origin: str
) -> NDArray[np.float32]:
    """Return the map (height, width) float32 in the model's pixels, its sign as ours, NaN for what is no number.

    Height and width are two neighbouring axes of the output; of the others at most one, the channels, may be larger than
    1. `DataError` where there is no such map, or not so many channels.
    """
    shown = f"an output of {'x'.join(map(str, output.shape)) or 'one number'}"
    if output.dtype.kind not in "fiu":
        raise DataError(f"{origin} gave {output.dtype} values, but a disparity is a number: export the disparity")
    for row in range(output.ndim - 1):
        if output.shape[row : row + 2] != (height, width):
            continue
        planes = np.moveaxis(output, (row, row + 1), (-2, -1))
        others = [size for size in planes.shape[:-2] if size > 1]
        if len(others) <= 1:
            channels = planes.reshape(-1, height, width)
            if convention.channel >= len(channels):
                raise DataError(
                    f"{origin} gave {shown}: channel={convention.channel}, but there are {len(channels)}, counted from 0"
                )
            found = np.asarray(channels[convention.channel], np.float32) * np.float32(convention.sign)
            return np.where(np.isfinite(found), found, np.float32(np.nan)) + np.float32(0)  # no -0
    raise DataError(
        f"{origin} gave {shown} for pictures of {width}x{height}: a disparity map has the pictures' height and width on "
        "neighbouring axes and at most one axis of channels beside them, export it so"
    )
