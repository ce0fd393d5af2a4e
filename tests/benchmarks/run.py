"""The benchmark table: every `bench_*.py` beside this file, each row a ratio to a named peer timed in the same run.

python tests/benchmarks/run.py [NAME ...]      e.g. `codec match`
"""

from __future__ import annotations

import importlib.util
import platform
import sys
from pathlib import Path

import cv2

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))
THREADS = 2


def main(names: list[str]) -> None:
    cv2.setNumThreads(THREADS)
    machine = f"{platform.machine()}, Python {platform.python_version()}, OpenCV {cv2.__version__}"
    print(f"{machine} on {THREADS} threads; medians of interleaved rounds")
    print(f"{'what':44} {'ours ms':>9} {'peer ms':>9} {'peer/ours':>9}  peer; note")
    for file in sorted(HERE.glob("bench_*.py")):
        if names and file.stem.removeprefix("bench_") not in names:
            continue
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        for row in module.measure():
            print(
                f"{row.name:44} {row.ours_ms:9.2f} {row.peer_ms:9.2f} {row.ratio:9.2f}  {row.peer}; {row.note}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
