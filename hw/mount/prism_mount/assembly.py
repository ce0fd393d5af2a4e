"""All printed parts of one mount, in place in the rig frame."""

from __future__ import annotations

from dataclasses import dataclass

from build123d import Compound, Part

from prism_mount import mirror_seat, prism_seat
from prism_mount.body import body
from prism_mount.brackets import bracket
from prism_mount.hole import Hole
from prism_mount.layout import Layout

__all__ = ["Assembly", "assemble"]


@dataclass(frozen=True, slots=True)
class Assembly:
    """Printed parts by name, their holes, and the glass that goes in (for drawings)."""

    layout: Layout
    parts: dict[str, Part]
    holes: tuple[Hole, ...]
    glass: dict[str, Part]

    def compound(self) -> Compound:
        """Return the printed parts as one labelled compound."""
        children = []
        for name, part in self.parts.items():
            part.label = name
            children.append(part)
        return Compound(label=f"{self.layout.rig.name}-mount", children=children)


def assemble(layout: Layout) -> Assembly:
    """Cut every part of a layout; each must come out as one sound solid."""
    left, right = layout.seat(-1.0), layout.seat(1.0)
    made = {
        "body": body(layout),
        "carrier-left": mirror_seat.carrier(layout, left),
        "carrier-right": mirror_seat.carrier(layout, right),
        "clamp": (prism_seat.clamp(layout), prism_seat.clamp_holes(layout)),
        "bracket": bracket(layout),
    }
    parts = {name: part for name, (part, _) in made.items()}
    for name, part in parts.items():
        if len(part.solids()) != 1 or not part.is_valid:
            raise ArithmeticError(f"part {name} came out as {len(part.solids())} solids, valid: {part.is_valid}")
    return Assembly(
        layout=layout,
        parts=parts,
        holes=tuple(hole for _, holes in made.values() for hole in holes),
        glass={
            "prism": prism_seat.prism(layout),
            "mirror-left": mirror_seat.mirror(layout, left),
            "mirror-right": mirror_seat.mirror(layout, right),
        },
    )
