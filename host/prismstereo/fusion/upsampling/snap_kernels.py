"""Compiled loop over all cells across a depth edge of a band: votes, the side map, pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.net_kernels import decide
from prismstereo.fusion.upsampling.render_kernels import render_cells
from prismstereo.fusion.upsampling.site_kernels import RIM
from prismstereo.fusion.upsampling.vote_kernels import LANES, collect_labels, collect_sites, near_and_far, vote_at
from prismstereo_device.compiled import compiled, compiled_any

__all__ = ["snap_cells", "vote_all"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]
_HALF = np.float32(0.5)
_LITTLE = np.float32(1e-3)


@compiled
def _split(sites: Float, stride: int, cells: Int, middles: Float, halves: Float) -> None:
    """Write the middle between near and far side of each cell, and half the gap."""
    for lane in range(LANES):
        at = np.uintp(cells[lane])
        below = at + np.uintp(stride)
        low, high = near_and_far(sites[at], sites[at + np.uintp(1)], sites[below], sites[below + np.uintp(1)])
        middles[lane], halves[lane] = (low + high) * _HALF, (high - low) * _HALF


@compiled
def _colours_at(guide: Byte, planes: int, rows: Int, columns: Int, place: Float) -> None:
    """Write the guide's colours (planes, LANES) at one place of each cell; `rows`, `columns` (LANES,) lead there together."""
    for z in range(planes):
        for lane in range(LANES):
            at = np.uintp(rows[np.uintp(lane)] + columns[np.uintp(lane)] + z)
            place[np.uintp(z * LANES + lane)] = np.float32(guide[at])


@compiled
def gather_inputs(
    guide: Byte, sites: Float, colours: Float, stride: int, cells: Int, offsets: Int, weights: Float,
    ranges: tuple[np.float32, np.float32], places: Int, row_places: Int, side: int, scratch: Float, inputs: Float,
) -> None:  # fmt: skip
    """Write what is known of each of LANES cells: inputs (2 side side + 16, LANES).

    First the votes, narrow and then wide, at side x side places, within -1 .. 1; then the sides of the 4x4 sites around.
    `places` and `row_places` are the pixels of all places of a row and a column of cells. `scratch` holds 64 (LANES,) and what
    the sites have to say.
    """
    area, planes, pitch = side * side, guide.shape[2], guide.shape[1] * guide.shape[2]
    bytes_ = guide.reshape(-1)
    middles, halves, sums = scratch[:LANES], scratch[LANES : 2 * LANES], scratch[2 * LANES : 6 * LANES]
    place, votes = scratch[6 * LANES : (6 + planes) * LANES], scratch[16 * LANES :]
    rows, columns = np.empty(side * LANES, np.int32), np.empty(side * LANES, np.int32)
    for lane in range(LANES):
        j, i = cells[lane] // stride - RIM, cells[lane] % stride - RIM
        for k in range(side):
            rows[k * LANES + lane], columns[k * LANES + lane] = (
                row_places[j * side + k] * pitch,
                places[i * side + k] * planes,
            )
    _split(sites, stride, cells, middles, halves)
    collect_sites(sites, colours, cells, offsets, middles, votes)
    for k in range(area):
        ky, kx = k // side * LANES, k % side * LANES
        _colours_at(bytes_, planes, rows[ky : ky + LANES], columns[kx : kx + LANES], place)
        vote_at(place, votes, weights[k], ranges[0], ranges[1], sums)
        for lane in range(LANES):
            at = np.uintp(lane)
            inputs[np.uintp(k * LANES + lane)] = sums[at] / (sums[at + np.uintp(LANES)] + _LITTLE)
        for lane in range(LANES):
            at = np.uintp(2 * LANES + lane)
            inputs[np.uintp((k + area) * LANES + lane)] = sums[at] / (sums[at + np.uintp(LANES)] + _LITTLE)
    collect_labels(sites, cells, stride, middles, halves, inputs[2 * area * LANES :])


@compiled_any
def snap_cells(
    guide: Byte, sites: Float, across: Float, down: Float, holes: Byte, colours: Float, cells: Int,
    offsets: Int, weights: Float, ranges: tuple[np.float32, np.float32], places: Int, row_places: Int, side: int,
    net: Float, layers: Int, starts: Int, spots: Int, shares: Float, parts: Float,
    row_starts: Int, row_spots: Int, row_shares: Float, row_parts: Float, out: Float, flags: Byte,
) -> None:  # fmt: skip
    """Decide and write the pixels of `cells` (N,), the upper left sites of cells across a depth edge."""
    stride, area, width = sites.shape[1], side * side, guide.shape[1]
    flat, flat_across, flat_down, flat_colours = (
        sites.reshape(-1), across.reshape(-1), down.reshape(-1), colours.reshape(-1)
    )  # fmt: skip
    pixels, pixel_flags = out.reshape(-1), flags.reshape(-1)
    scratch = np.zeros((16 + offsets.size * (guide.shape[2] + 1)) * LANES, np.float32)
    inputs = np.zeros((2 * area + 16) * LANES, np.float32)
    widest = max(layers[1:].max(), area) if layers.size else area
    hidden, field = np.zeros(widest * LANES, np.float32), np.zeros(widest * LANES, np.float32)
    block = np.zeros(LANES, np.int32)
    for begin in range(0, cells.size, LANES):
        count = min(LANES, cells.size - begin)
        for lane in range(LANES):
            block[lane] = cells[begin + min(lane, count - 1)]
        gather_inputs(
            guide, flat, flat_colours, stride, block, offsets, weights, ranges, places, row_places, side, scratch, inputs,
        )  # fmt: skip
        decide(inputs, area, net, layers, hidden, field)
        render_cells(
            flat, flat_across, flat_down, holes, stride, block[:count], field, side, starts, spots, shares, parts,
            row_starts, row_spots, row_shares, row_parts, width, pixels, pixel_flags,
        )  # fmt: skip


@compiled_any
def vote_all(
    guide: Byte, sites: Float, colours: Float, cells: Int, offsets: Int, weights: Float,
    ranges: tuple[np.float32, np.float32], places: Int, row_places: Int, side: int,
) -> tuple[Float, Float]:  # fmt: skip
    """Return the net's inputs of all `cells` (N,): (N, 2 side side + 16), and the disparity of either side, (N, 2)."""
    stride, many = sites.shape[1], 2 * side * side + 16
    flat, flat_colours = sites.reshape(-1), colours.reshape(-1)
    scratch = np.zeros((16 + offsets.size * (guide.shape[2] + 1)) * LANES, np.float32)
    inputs, block = np.zeros(many * LANES, np.float32), np.zeros(LANES, np.int32)
    known, gaps = np.empty((cells.size, many), np.float32), np.empty((cells.size, 2), np.float32)
    for begin in range(0, cells.size, LANES):
        count = min(LANES, cells.size - begin)
        for lane in range(LANES):
            block[lane] = cells[begin + min(lane, count - 1)]
        gather_inputs(
            guide, flat, flat_colours, stride, block, offsets, weights, ranges, places, row_places, side, scratch, inputs,
        )  # fmt: skip
        for lane in range(count):
            middle, half = scratch[lane], scratch[LANES + lane]
            gaps[begin + lane, 0], gaps[begin + lane, 1] = middle - half, middle + half
            for k in range(many):
                known[begin + lane, k] = inputs[k * LANES + lane]
    return known, gaps
