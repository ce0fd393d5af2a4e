"""Compiled loops of the small net that draws a cell's side map from the votes, LANES cells side by side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.vote_kernels import LANES
from prismstereo_device.compiled import compiled

__all__ = ["decide"]

Float = NDArray[np.float32]
Int = NDArray[np.int32]


@compiled
def decide(inputs: Float, area: int, net: Float, layers: Int, hidden: Float, field: Float) -> None:
    """Write the side map, field (area, LANES), of a block of cells.

    `layers` are the net's widths, from inputs to area, all but the last multiples of 8; `net` has the weights of each layer,
    output by output, and then its biases. Without layers the side map is the sum of the votes.
    """
    if not layers.size:
        for k in range(area * LANES):
            field[np.uintp(k)] = inputs[np.uintp(k)] + inputs[np.uintp(area * LANES + k)]
        return
    at, last = 0, layers.size - 2
    for layer in range(last + 1):
        fan, width = layers[layer], layers[layer + 1]
        # the layers take turns between two arrays, so that the last one ends in `field`
        ends_in_field = (last - layer) % 2 == 0
        source = inputs if layer == 0 else (hidden if ends_in_field else field)
        out = field if ends_in_field else hidden
        for o in range(0, width, 2):
            _weigh_two(
                source, net[at + o * fan : at + (o + 2) * fan], net[at + fan * width + o : at + fan * width + o + 2],
                out[o * LANES : (o + 2) * LANES],
            )  # fmt: skip
        if layer < last:
            for k in range(width * LANES):
                out[np.uintp(k)] = max(out[np.uintp(k)], np.float32(0))
        at += (fan + 1) * width


@compiled
def _weigh_two(source: Float, weights: Float, biases: Float, out: Float) -> None:
    """Write two biases plus weighted sums of the source's lanes; the order of the sums is fixed."""
    fan = weights.size // 2
    for o in range(2):
        bias = biases[o]
        for lane in range(LANES):
            out[np.uintp(o * LANES + lane)] = bias
    for i in range(0, fan, 4):
        a, b, c, d = weights[i], weights[i + 1], weights[i + 2], weights[i + 3]
        e, f, g, h = weights[fan + i], weights[fan + i + 1], weights[fan + i + 2], weights[fan + i + 3]
        for lane in range(LANES):
            at, other = np.uintp(i * LANES + lane), np.uintp(LANES + lane)
            one, two = source[at], source[at + np.uintp(LANES)]
            three, four = source[at + np.uintp(2 * LANES)], source[at + np.uintp(3 * LANES)]
            out[np.uintp(lane)] += (a * one + b * two) + (c * three + d * four)
            out[other] += (e * one + f * two) + (g * three + h * four)
