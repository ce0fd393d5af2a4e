"""Files of a finished mount: the assembly as STEP and STL, each part turned for the printer, the base plate as DXF."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from build123d import ExportDXF, Location, Part, Plane, Unit, export_step, export_stl

from prism_mount.assembly import Assembly
from prism_mount.layout import Layout

__all__ = ["export_assembly", "export_plate", "export_printable", "flat_for_printing"]

_CHORD_MM, _CHORD_RAD = 0.05, 0.3
_STAMP = datetime(2026, 1, 1, tzinfo=UTC)  # a fixed date, so that the same rig gives the same bytes


def _stl(part: Part, path: Path) -> None:
    if not export_stl(part, str(path), tolerance=_CHORD_MM, angular_tolerance=_CHORD_RAD):
        raise OSError(f"{path} could not be written as STL")


def export_assembly(assembly: Assembly, folder: Path) -> None:
    """Write `mount.step` (labelled parts) and `mount.stl` (binary), all printed parts in place in the rig frame."""
    whole = assembly.compound()
    export_step(whole, str(folder / "mount.step"), write_pcurves=False, timestamp=_STAMP)
    _stl(whole, folder / "mount.stl")


def _down(layout: Layout, name: str) -> tuple[float, float, float]:
    """Return the direction of the rig frame that lies on the printer's bed."""
    if name.startswith("carrier"):
        return tuple(layout.seat(1.0 if name.endswith("right") else -1.0).w)
    if name == "clamp":
        return 0.0, -1.0, 0.0
    if name in ("body", "rails"):
        return 0.0, 1.0, 0.0
    return 0.0, 0.0, 1.0


def flat_for_printing(layout: Layout, name: str, part: Part) -> Part:
    """Turn a part so that its largest flat side lies on z = 0, as a printer wants it."""
    key = "rails" if name == "bracket" and layout.interface.kind == "housing" else name
    down = np.array(_down(layout, key))
    across = np.array([1.0, 0.0, 0.0]) if abs(down[0]) < 0.1 else np.array([0.0, 1.0, 0.0])
    turned = Part() + part.moved(Location(Plane(origin=(0, 0, 0), x_dir=tuple(across), z_dir=tuple(-down))).inverse())
    box = turned.bounding_box()
    middle = box.center()
    return Part() + turned.moved(Location((-middle.X, -middle.Y, -box.min.Z)))


def export_printable(layout: Layout, parts: dict[str, Part], folder: Path) -> None:
    """Write every part as a binary STL that lies on the bed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, part in parts.items():
        _stl(flat_for_printing(layout, name, part), folder / f"{name}.stl")


def export_plate(assembly: Assembly, path: Path) -> None:
    """Write the base plate's underside, outline and holes, as DXF in mm (x right, y forwards): for a cut plate."""
    layout = assembly.layout
    faces = [
        face
        for face in assembly.parts["body"].faces()
        if abs(face.center().Y - layout.underside_mm) < 1e-6 and face.normal_at().Y > 0.999
    ]
    plane = Plane(origin=(0, layout.underside_mm, 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
    drawing = ExportDXF(unit=Unit.MM)
    drawing.add_layer("cut")
    for face in faces:
        drawing.add_shape(plane.to_local_coords(face).edges(), layer="cut")
    drawing.write(str(path))
