"""The two sweeps: rows there and back into a volume, then columns there and back, each tile decided as it is finished.

The column sums of a tile never leave the cache: they are merged with the row sums, and the tile is decided, before the
next one begins. Rows of tiles are independent in the first sweep, columns of tiles in the second, exactly.

The way back needs the costs and sums of the way there. Where those of a whole path are more than a cache holds, the path is
walked in stages: only its state at each stage's begin is kept, and on the way back each stage is walked forward again.
Arithmetic is cheaper than memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any
from prismstereo_device.match.tiles.census_kernels import EDGE, PLANES, lay, look
from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.path_kernels import (
    HELD_BYTES,
    LINK_BYTES,
    ListArrays,
    backward,
    begin_paths,
    forward,
    move_state,
)
from prismstereo_device.match.tiles.winner_kernels import decide_tile, merge_tile

__all__ = ["sweep_columns", "sweep_rows"]

Bytes = NDArray[np.uint8]
Shorts = NDArray[np.int16]
Labels = NDArray[np.uint8] | NDArray[np.uint16]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Sides = tuple[Bytes, Bytes]
Walk = tuple[Ints, Bytes, Bytes, Bytes, Bytes, Bytes, Bytes, Bytes, Longs]  # see scratch.Desk.walk
Right = tuple[Bytes, Labels, int]
Maps = tuple[Shorts, Labels, Bytes, Longs]

_NO_COST = 255
_PATHS = 4


@compiled_any
def _stages(counts: Longs, tile: int, tile_step: int, tiles: int, room: int, begins: Longs) -> int:
    """Cut a path into stages whose costs fit in `room` bytes, a tile at least; write their first tiles and return how many."""
    number, filled = 0, room + 1
    for n in range(tiles):
        size = counts[tile + n * tile_step] * TILE * HELD_BYTES
        if filled + size > room:
            begins[number] = n
            number += 1
            filled = 0
        filled += size
    begins[number] = tiles
    return number


@compiled_any
def _walk_stages(
    sides: tuple[Bytes, Bytes, Bytes], places: Longs, strides: Longs, lists: ListArrays, tile: int, length: int,
    penalties: Longs, walk: Walk, turn: int, stages: int,
) -> int:  # fmt: skip
    """Walk 32 paths to where the way back begins its `turn`-th stage; return the bytes in `held`.

    The first turn walks through all stages and keeps the paths' state at the begin of each, later ones walk one stage again.
    """
    across, inside, paths, least, _, _, held, kept, begins = walk
    most = inside.size // LINK_BYTES
    last = stages - 1 - turn
    first = last if turn > 0 else 0
    cell = 0
    for stage in range(first, last + 1):
        begin, end = begins[stage] * TILE, min(begins[stage + 1] * TILE, length)
        if stage == 0:
            begin_paths(paths, least, most)
        else:
            size = lists[2][tile + (begins[stage] - 1) * strides[6]] * TILE
            move_state(kept, stage * (most + 1) * TILE, paths, least, begin, size, turn == 0)
        cell = forward(
            sides, places, strides, lists, tile, begin, end, penalties, (across, inside), paths, least, held
        )  # fmt: skip
    return cell


@compiled_any
def sweep_rows(
    padded: Sides, upright: Sides, lying: Sides, grey: Bytes, lists: ListArrays, penalties: Longs, walk: Walk, volume: Bytes,
    width: int, begin: int, end: int,
) -> None:  # fmt: skip
    """Look at the tile rows begin .. end, and sum their costs along rows, both ways, into the volume.

    Upright planes are kept for the columns; lying ones, left and right (columns, 4, 32), and grey (columns, 32) serve one row
    of tiles after the other and stay in the cache.
    """
    across, inside, _, _, paths_back, least_back, held, _, begins = walk
    columns = lying[0].shape[0]
    offset = lying[1].shape[0] - columns
    tiles = columns // TILE
    step = PLANES * TILE
    places, strides = np.array([0, offset * step, 0]), np.array([step, step, TILE, TILE, TILE, step, 1])
    for row in range(begin, end):
        look(padded[0], upright[0], lying[0], np.int64(0), row)
        look(padded[1], upright[1], lying[1], offset, row)
        lay(padded[0], grey, row)
        first = row * tiles
        stages = _stages(lists[2], first, strides[6], tiles, held.size, begins)
        begin_paths(paths_back, least_back, inside.size // LINK_BYTES)
        done = np.int64(0)
        for turn in range(stages):
            cell = _walk_stages(
                (lying[0], lying[1], grey), places, strides, lists, first, width, penalties, walk, turn, stages
            )
            for column in range(begins[stages - turn] - 1, begins[stages - turn - 1] - 1, -1):
                c = first + column
                steps = min(TILE, width - column * TILE)
                backward(
                    grey, column * TILE * TILE, strides, lists, c, done, steps, penalties, (across, inside), paths_back,
                    least_back, held, cell, volume, lists[3][c],
                )  # fmt: skip
                cell -= steps * lists[2][c] * HELD_BYTES
                done += steps


@compiled_any
def _finish_tile(
    lists: ListArrays, known: Bytes, c: int, down: Bytes, merged: Bytes, volume: Bytes, right: Right, at: int, stride: int,
    edge: Bytes, maps: Maps, row: int, steps: int, column: int, unique: int, price: int,
) -> None:  # fmt: skip
    """Merge a tile's two sums and decide its pixels."""
    labels, starts, counts, volumes = lists
    disparity, winner, margin, margins = maps
    merge_tile(down, volume, volumes[c], merged, right[0], right[1], at, stride, edge, labels, starts[c], counts[c])
    rival = _NO_COST if known[c] else 0
    decide_tile(
        merged, labels, starts[c], counts[c], disparity, winner, margin, row, steps, column, margins, unique, rival, price
    )  # fmt: skip


@compiled_any
def sweep_columns(
    padded: Bytes, upright: Sides, lists: ListArrays, known: Bytes, penalties: Longs, walk: Walk, tile_sums: Sides,
    volume: Bytes, right: Right, maps: Maps, width: int, height: int, unique: int, begin: int, end: int,
) -> None:  # fmt: skip
    """Sum the costs of the tile columns begin .. end along columns, both ways, and decide every tile.

    right: costs and labels of the right winners, and where in them this worker's begin: a row of (end - begin) * 32 + offset
    pixels for each row. maps: disparity, winner, margin, and the margins. Tiles that are not `known` are ambiguous.
    """
    across, inside, _, _, paths_back, least_back, held, _, begins = walk
    columns = upright[0].shape[2]
    offset = upright[1].shape[2] - columns
    tiles, wide = columns // TILE, columns + offset
    stride = (end - begin) * TILE + offset
    for i in range(height * stride):
        right[0][right[2] + i] = _NO_COST
    row_bytes = padded.shape[1]
    strides = np.array([PLANES * columns, PLANES * wide, row_bytes, columns, wide, 1, tiles])
    edge = np.zeros(TILE, np.uint8)
    for column in range(begin, end):
        x = column * TILE
        for lane in range(TILE):
            edge[lane] = _NO_COST if x + lane >= width else 0
        places = np.array([x, offset + x, EDGE * row_bytes + EDGE + x])
        stages = _stages(lists[2], column, strides[6], -(-height // TILE), held.size, begins)
        begin_paths(paths_back, least_back, inside.size // LINK_BYTES)
        done = np.int64(0)
        for turn in range(stages):
            cell = _walk_stages(
                (upright[0], upright[1], padded), places, strides, lists, column, height, penalties, walk, turn, stages
            )  # fmt: skip
            for row in range(begins[stages - turn] - 1, begins[stages - turn - 1] - 1, -1):
                c = row * tiles + column
                steps = min(TILE, height - row * TILE)
                backward(
                    padded, places[2] + row * TILE * row_bytes, strides, lists, c, done, steps, penalties, (across, inside),
                    paths_back, least_back, held, cell, tile_sums[0], np.int64(0),
                )  # fmt: skip
                cell -= steps * lists[2][c] * HELD_BYTES
                done += steps
                at = right[2] + row * TILE * stride + offset + x - begin * TILE
                _finish_tile(
                    lists, known, c, tile_sums[0], tile_sums[1], volume, right, at, stride, edge, maps, row * TILE, steps, x,
                    unique, _PATHS * penalties[0],
                )  # fmt: skip
