"""A pair of grey pictures as the tensors that a model takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.learned.convention import Convention
from prismstereo_device.match.learned.fitting import resized
from prismstereo_device.match.learned.model_shape import ModelShape
from prismstereo_hw.errors import DataError

__all__ = ["tensors"]

# ImageNet's colours, red green blue: mean and deviation of values 0 .. 1
_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
_WHITE = 255.0
_TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
}

Grey = NDArray[np.uint8]


def tensors(
    left: Grey, right: Grey, shape: ModelShape, convention: Convention, origin: str
) -> dict[str, NDArray[np.generic]]:
    """Make the inputs by name of two grey pictures (height, width) of the size that the model works at.

    Three channels all show the grey picture. `DataError` where the model wants bytes and the convention none.
    """
    pictures = [left, right]
    if shape.halved:
        height, width = left.shape[0] // 2, left.shape[1] // 2
        pictures = [resized(left, height, width), resized(right, height, width), left, right]
    planes = [_planes(picture, shape.channels, convention) for picture in pictures]
    if shape.stacked:
        planes = [np.concatenate(planes)]
    made: dict[str, NDArray[np.generic]] = {}
    for port, values in zip(shape.inputs, planes, strict=True):
        kind = _TYPES[port.kind]
        if kind is np.uint8 and convention.scale != "none":
            raise DataError(
                f"input {port} of {origin} takes bytes, but scale={convention.scale} makes fractions: use scale=none"
            )
        placed = values if shape.layout == "nchw" else np.moveaxis(values, 0, -1)
        made[port.name] = np.ascontiguousarray(placed[np.newaxis], kind)
    return made


def _planes(grey: Grey, channels: int, convention: Convention) -> NDArray[np.float32]:
    """Return a picture as (channels, height, width) float32 on the model's scale."""
    offset, span = _scale(channels, convention)
    levels = np.repeat(grey[np.newaxis].astype(np.float32), channels, axis=0)
    return np.asarray((levels - offset[:, None, None]) / span[:, None, None], np.float32)


def _scale(channels: int, convention: Convention) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return what is taken off each channel's grey levels, and what they are then divided by."""
    zero, one = np.zeros(channels, np.float32), np.ones(channels, np.float32)
    if convention.scale == "none":
        return zero, one
    if convention.scale == "unit":
        return zero, one * np.float32(_WHITE)
    if convention.scale == "symmetric":
        return one * np.float32(_WHITE / 2), one * np.float32(_WHITE / 2)
    if channels == 1:
        return one * _MEAN.mean() * np.float32(_WHITE), one * _DEVIATION.mean() * np.float32(_WHITE)
    backwards = -1 if convention.order == "bgr" else 1
    return _MEAN[::backwards] * np.float32(_WHITE), _DEVIATION[::backwards] * np.float32(_WHITE)
