"""Makes the camera's locks from the project's: the same versions and hashes, and only what runs on a camera.

python device/image/lock.py
"""

from __future__ import annotations

import re
from pathlib import Path

HERE = Path(__file__).parent
PROJECT_LOCK = HERE.parents[1] / "requirements.lock"

CAMERA = (
    "cffi",
    "cryptography",
    "google-crc32c",
    "llvmlite",
    "msgspec",
    "numba",
    "numpy",
    "opencv-python-headless",
    "pycparser",
    "pyserial",
    "tomli-w",
    "zstandard",
)
LOCKS = {"requirements.lock": CAMERA, "requirements-oak.lock": (*CAMERA, "depthai")}

_ENTRY = re.compile(r"^([A-Za-z0-9._-]+)==.*(?:\n .*)*", re.MULTILINE)


def selected(lock: str, names: tuple[str, ...]) -> str:
    """Give the entries of a lock that have one of these names, as they stand there; `KeyError` for one that is missing."""
    entries = [(match[1], match[0]) for match in _ENTRY.finditer(lock)]
    missing = set(names) - {name for name, _ in entries}
    if missing:
        raise KeyError(f"{', '.join(sorted(missing))}: not in the project's lock")
    return "".join(f"{entry}\n" for name, entry in entries if name in names)


def main() -> None:
    """Write the locks beside this file."""
    for file, names in LOCKS.items():
        (HERE / file).write_text(selected(PROJECT_LOCK.read_text(), names))


if __name__ == "__main__":
    main()
