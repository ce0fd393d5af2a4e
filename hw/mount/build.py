"""Build the mount of a rig: `python hw/mount/build.py oak-1 [-o DIR] [--camera lens-M58]`; needs the extra `cad`.

`--all` rebuilds everything that is kept under hw/mount/out: the three rigs, the lens rings, the bill, the pictures.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from prism_mount.assembly import Assembly, assemble
from prism_mount.drawing import draw
from prism_mount.export import export_assembly, export_plate, export_printable
from prism_mount.guide import draw_guide
from prism_mount.interface import FOR_RIG, INTERFACES
from prism_mount.layout import Layout
from prism_mount.lens_ring import lens_ring
from prism_mount.record import record

from prismstereo_hw.errors import PrismStereoError, UsageError
from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.rig import Rig

HERE = Path(__file__).resolve().parent
RING_BORE_MM = {"lens-M49": 12.6, "lens-M52": 12.6, "lens-M58": 12.6, "c-mount": 9.5}


def build(rig_name: str, folder: Path, camera: str | None) -> Assembly:
    """Build one rig's mount into a folder and return it; `UsageError` for a rig that this mount cannot hold."""
    rig = Rig.read(rig_name)
    if not isinstance(rig, PrismRig):
        raise UsageError(f"rig {rig.name!r} has no prism before two mirrors: this mount holds rigs of kind prism_tir")
    camera = camera or FOR_RIG.get(rig.name)
    if camera not in INTERFACES:
        raise UsageError(f"camera {camera!r} has no interface here: give --camera, one of {', '.join(INTERFACES)}")
    assembly = assemble(Layout.of(rig, INTERFACES[camera]))
    folder.mkdir(parents=True, exist_ok=True)
    export_assembly(assembly, folder)
    export_plate(assembly, folder / "plate.dxf")
    parts = dict(assembly.parts)
    if assembly.layout.interface.kind == "thread":
        rear = assembly.layout.wall_rear_mm
        bore = assembly.layout.bore_mm(rear, rear - 7.0)
        parts["bracket"], _ = lens_ring(assembly.layout, assembly.layout.interface, bore, threaded=True)
    export_printable(assembly.layout, parts, folder / "print")
    (folder / "mount.json").write_text(json.dumps(record(assembly), indent=1) + "\n", "utf-8")
    draw(assembly, folder / "drawing.svg")
    return assembly


def build_rings(layout: Layout, folder: Path) -> None:
    """Write every threaded ring as STL: all fit every body."""
    rings = {name: lens_ring(layout, INTERFACES[name], bore, threaded=True)[0] for name, bore in RING_BORE_MM.items()}
    export_printable(layout, rings, folder)


def build_all(folder: Path) -> None:
    """Rebuild what is kept in the repository."""
    made = {name: build(name, folder / name, None) for name in FOR_RIG}
    build_rings(made["dslr-35mm"].layout, folder / "rings")
    draw_guide(made["oak-1"], folder / "guide")


def main() -> int:
    """Read the command line and build; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("rig", nargs="?", help="built-in rig, or the path of a rig file")
    parser.add_argument("-o", "--out", type=Path, help="folder (default: hw/mount/out/RIG)")
    parser.add_argument(
        "--camera", choices=sorted(INTERFACES), help="how the camera is held (default: by the rig's name)"
    )
    parser.add_argument("--all", action="store_true", help="rebuild everything that is kept under hw/mount/out")
    wish = parser.parse_args()
    if not wish.all and not wish.rig:
        parser.error("name a rig (oak-1, dslr-35mm, pi-camera-v2, a file), or give --all")
    try:
        if wish.all:
            build_all(wish.out or HERE / "out")
        else:
            build(wish.rig, wish.out or HERE / "out" / Path(wish.rig).stem, wish.camera)
    except PrismStereoError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
