"""What to turn, move or clean when a figure of an alignment is out of tolerance, in words.

Right, left, up, down and clockwise are those of the picture, as the camera looks; a mirror's face is its silvered side.
"""

from __future__ import annotations

import math

__all__ = [
    "DISTANCE_UNKNOWN",
    "band",
    "brightness",
    "focus",
    "not_flat",
    "roll",
    "seam",
    "slant",
    "tip",
    "vergence",
    "vertical",
]

DISTANCE_UNKNOWN = (
    "a turn about the upright axis hides in the depths of what is seen: let the rig look at a flat target at a known distance "
    "and give --distance-mm"
)


def seam(aside_mm: float) -> str:
    """Mend an apex that stands `aside_mm` to the right of the lens' axis."""
    way, other = ("left", "right") if aside_mm > 0 else ("right", "left")
    return (
        f"move the prism with its mirrors {abs(aside_mm):.2f} mm to the {way}, or the lens as much to the {other}; where the "
        "lens is fixed to a sensor that is off its axis, let it be: calibration takes it up"
    )


def slant(leans_deg: float) -> str:
    """Mend a seam that leans to the right going down."""
    if math.isnan(leans_deg):
        return "the seam is too wide a band to tell its slant: close the aperture"
    way = "clockwise" if leans_deg > 0 else "counter-clockwise"
    return f"turn the prism with its mirrors {abs(leans_deg):.1f} deg {way} before the camera, ahead of all else"


def band(width_px: float, wish_px: float) -> str:
    """Mend a blended band that is too wide."""
    return (
        f"{width_px:.0f} columns show both views where {wish_px:.0f} should: close the aperture, or bring the lens back to its "
        "distance from the prism"
    )


def vertical(offset_px: float, turn_deg: float) -> str:
    """Mend a right view whose points lie `offset_px` lower than the left view's."""
    where = "lower" if offset_px > 0 else "higher"
    return (
        f"points lie {abs(offset_px):.1f} px {where} in the right view: tip the optics of one view about a level line by "
        f"{abs(turn_deg):.2f} deg of its line of sight, see the tips of its mirrors"
    )


def roll(turn_deg: float) -> str:
    """Mend a right view whose picture is turned clockwise against the left view's."""
    way = "clockwise" if turn_deg > 0 else "counter-clockwise"
    return f"the right view's picture is turned {abs(turn_deg):.2f} deg {way}: tip one view's optics, see the mirrors' tips"


def tip(side: str, tip_deg: float, height_mm: float) -> str:
    """Mend a mirror whose face leans down by `tip_deg`: its upper edge stands forward, out of its face."""
    edge_mm = height_mm * math.tan(math.radians(abs(tip_deg)))
    leans, way = ("down", "back, away from its face") if tip_deg > 0 else ("up", "forward, out of its face")
    return (
        f"the {side} mirror's face leans {leans}: turn its upper screw until it has tipped by {abs(tip_deg):.2f} deg, its "
        f"upper edge by {edge_mm:.2f} mm {way}"
    )


def vergence(error_deg: float, mirrors: bool) -> str:
    """Mend views that converge `error_deg` too much."""
    if not mirrors:
        way = "apart" if error_deg > 0 else "together"
        return f"turn the views {abs(error_deg):.2f} deg {way}"
    way = "smaller" if error_deg > 0 else "larger"
    return (
        f"make the angle of one mirror to the prism's base {abs(error_deg) / 2:.2f} deg {way}, or of both by half as much: "
        "which of the two is off cannot be seen"
    )


def not_flat(left_px: float) -> str:
    """Explain a target that does not look like a plane."""
    return (
        f"the target leaves {left_px:.1f} px: it is not one flat thing at that distance in both views; take a flat one that "
        "fills them, or leave --distance-mm out"
    )


def focus(ratio: float, halves: tuple[str, str]) -> str:
    """Mend a left view that is `ratio` times as sharp as the right one; `halves` says where each of them lies."""
    side, half, share = ("left", halves[0], ratio) if ratio < 1 else ("right", halves[1], 1 / ratio)
    return (
        f"the {side} view ({half} of the frame) has {100 * share:.0f} % of the other's sharpness: wipe its mirror and prism "
        "face, ease the clamp that bends its mirror, and focus again"
    )


def brightness(ratio: float, halves: tuple[str, str]) -> str:
    """Mend a left view that is `ratio` times as bright as the right one."""
    side, half, share = ("left", halves[0], ratio) if ratio < 1 else ("right", halves[1], 1 / ratio)
    return (
        f"the {side} view ({half} of the frame) has {100 * share:.0f} % of the other's light: clean its mirror, and look for "
        "what shades it, and for stray light on the other one"
    )
