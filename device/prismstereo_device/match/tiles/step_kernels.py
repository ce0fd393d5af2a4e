"""One pixel of 32 paths that lie side by side: the innermost loop of the sweeps, over the labels of a tile."""

from __future__ import annotations

from prismstereo_device.match.tiles.census_kernels import PLANES
from prismstereo_device.match.tiles.lanes import BYTES, PIECES, TILE, Code, Memory, Value, kernel, total

__all__ = [
    "ABSENT", "AHEAD", "DOWN", "HELD_BYTES", "LABEL_BYTES", "LINE", "LINK_BYTES", "UP", "backward_across", "backward_inside",
    "fetch", "forward_across", "forward_inside",
]  # fmt: skip

ABSENT = 200  # more than any path holds, and still a byte after P1 is added
LABEL_BYTES = TILE * TILE + 64  # not a power of two: neighbours would share cache sets
HELD_BYTES = 2 * TILE  # of a label and pixel on the way there: the costs, then the sums
LINK_BYTES = 8  # of a label inside a tile: place of its right pixel (int32), then two prices
DOWN, UP = 4, 5  # where these are
LINE, AHEAD = 64, 4  # bytes of a cache line; rows between asking for one and using it


def _jump(grey: Memory, here: Value, before: Value, high: Value, low: Value) -> Value:
    """P2 less the step of the grey level, at least `low`."""
    one, other = grey.load(here), grey.load(before)
    step = one.sub_saturating(other) | other.sub_saturating(one)
    high_everywhere = high.everywhere(BYTES)
    return high_everywhere - step.least(high_everywhere - low.everywhere(BYTES))


class _Before:
    """What the pixel before offers a label: the least of staying, moving by one label, and jumping."""

    def __init__(self, code: Code, paths: Memory, links: Memory, *, crossing: bool) -> None:
        self.code, self.paths, self.links, self.crossing = code, paths, links, crossing

    def begin(self, at: Value, most: Value, penalty: Value, offset: int) -> None:
        self.at, self.most, self.offset = at + offset, most, offset
        if self.crossing:
            self.penalty = penalty.everywhere(BYTES)
            return
        self.lower, self.here = self.code.variable(BYTES, ABSENT), self.code.variable(BYTES, 0)
        self.here.value = self.paths.load(self.at)

    def least(self, k: Value) -> Value:
        if self.crossing:  # links: places of the same label, the one below and the one above in the tile before
            same, below, above = (self.paths.load(self.at + self.links.number(self.most * n + k)) for n in range(3))
            return same.least(below + self.penalty).least(above + self.penalty)
        same, above = self.here.value, self.paths.load(self.at + k * TILE + TILE)
        below = self.lower.value.add_saturating(self.links.spread(k * LINK_BYTES + DOWN))
        self.lower.value, self.here.value = same, above
        return same.least(below).least(above.add_saturating(self.links.spread(k * LINK_BYTES + UP)))


def _forward_step(
    code: Code, left: Memory, right: Memory, inside: Memory, across: Memory, paths: Memory, least: Memory, held: Memory,
    grey: Memory, count: Value, most: Value, at_left: Value, plane_left: Value, at_right: Value, plane_right: Value,
    cell: Value, before: Value, after: Value, p1: Value, p2: Value, p2_low: Value, grey_here: Value, grey_before: Value, *,
    crossing: bool,
) -> None:  # fmt: skip
    offers = _Before(code, paths, across if crossing else inside, crossing=crossing)
    for piece in PIECES:
        looks = [left.load(at_left + plane_left * plane + piece) for plane in range(PLANES)]
        floor = least.load(code.number(piece))
        jump = floor + _jump(grey, grey_here + piece, grey_before + piece, p2, p2_low)
        lowest = code.variable(BYTES, 255)
        offers.begin(before, most, p1, piece)
        with code.each(count) as k:
            there = at_right - inside.number(k * (LINK_BYTES // 4)) + piece
            cost = total(
                [(look ^ right.load(there + plane_right * plane)).bits_set() for plane, look in enumerate(looks)]
            )
            path = offers.least(k).least(jump) - floor + cost
            paths.store(after + k * TILE + piece, path)
            held.store(cell + k * HELD_BYTES + piece, cost)
            held.store(cell + k * HELD_BYTES + TILE + piece, path)
            lowest.value = lowest.value.least(path)
        least.store(code.number(piece), lowest.value)


@kernel(arrays=8, numbers=14)
def forward_inside(code: Code, *given: Value) -> None:
    """One pixel of 32 paths, in the same tile as the one before."""
    _forward_step(code, *given, crossing=False)  # type: ignore[arg-type]


@kernel(arrays=8, numbers=14)
def forward_across(code: Code, *given: Value) -> None:
    """One pixel of 32 paths, the first one of a tile."""
    _forward_step(code, *given, crossing=True)  # type: ignore[arg-type]


@kernel(arrays=3, numbers=6)
def fetch(
    code: Code, left: Memory, right: Memory, grey: Memory, at_left: Value, plane_left: Value, at_right: Value,
    plane_right: Value, lines: Value, at_grey: Value,
) -> None:  # fmt: skip
    """Ask for the planes and greys of a row to come: no processor guesses steps of whole rows."""
    grey.prefetch(at_grey)
    for plane in range(PLANES):
        left.prefetch(at_left + plane_left * plane)
    with code.each(lines) as line:
        for plane in range(PLANES):
            right.prefetch(at_right + plane_right * plane + line * LINE)


def _backward_step(
    code: Code, inside: Memory, across: Memory, paths: Memory, least: Memory, held: Memory, volume: Memory, grey: Memory,
    count: Value, most: Value,
    cell: Value, out: Value, before: Value, after: Value, p1: Value, p2: Value, p2_low: Value, grey_here: Value,
    grey_before: Value, *, crossing: bool,
) -> None:  # fmt: skip
    offers = _Before(code, paths, across if crossing else inside, crossing=crossing)
    for piece in PIECES:
        floor = least.load(code.number(piece))
        jump = floor + _jump(grey, grey_here + piece, grey_before + piece, p2, p2_low)
        lowest = code.variable(BYTES, 255)
        offers.begin(before, most, p1, piece)
        with code.each(count) as k:
            both = cell + k * HELD_BYTES + piece
            path = offers.least(k).least(jump) - floor + held.load(both)
            paths.store(after + k * TILE + piece, path)
            volume.store(out + k * LABEL_BYTES + piece, path + held.load(both + TILE))
            lowest.value = lowest.value.least(path)
        least.store(code.number(piece), lowest.value)


@kernel(arrays=7, numbers=11)
def backward_inside(code: Code, *given: Value) -> None:
    """One pixel of 32 paths on their way back, in the same tile as the one before."""
    _backward_step(code, *given, crossing=False)  # type: ignore[arg-type]


@kernel(arrays=7, numbers=11)
def backward_across(code: Code, *given: Value) -> None:
    """One pixel of 32 paths on their way back, the first one of a tile."""
    _backward_step(code, *given, crossing=True)  # type: ignore[arg-type]
