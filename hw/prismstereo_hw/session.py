"""A session folder: raw video, stills, board views and, from the twin, the truth.

session.toml             rig, frame sizes and rate, what is present
video/000000.png ...     raw frames                     stills/000000.png ...   full-sensor stills
boards/000000.png ...    calibration board views        boards_still/000000.png ...  the same poses, by number, as stills
background/video.png     the scene without its objects
timestamps.csv           kind, index, microseconds at mid-exposure
calibration.json         if there is one
truth/lens.toml          true lens and pose of both views' pinholes
truth/depth/000000.pfm   per pixel of the raw LEFT view: depth along its optical axis, mm
truth/match/000000.npy   per pixel of the raw LEFT view: x and y of the same point in the raw RIGHT view
truth/occluded/000000.png  255 where the left view alone sees the point
truth/objects/000000.png   index of the object plus one
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import cv2
import msgspec
import numpy as np
import tomli_w
from numpy.typing import NDArray

from prismstereo_hw import pfm
from prismstereo_hw.errors import DataError, SessionError
from prismstereo_hw.files import read_array, read_picture, write_whole
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.rig import Rig
from prismstereo_hw.twin import Truth

__all__ = ["Kind", "Session", "SessionInfo", "SessionWriter"]

Kind = Literal["video", "stills", "boards", "boards_still"]
_MOST_BYTES = 1024 * 1024
_NUMBER = re.compile(r"[0-9]{1,12}")


class SessionInfo(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What session.toml says."""

    schema: Literal["prismstereo-session/1"]
    rig: str
    scene: str = ""
    video_width: int
    video_height: int
    video_rate_hz: float
    video_frames: int = 0
    still_frames: int = 0
    board_frames: int = 0
    board_still_frames: int = 0
    board: str = ""  # as the calibrate verb takes it, e.g. chessboard:9x7
    square_mm: float = 0.0
    truth: bool = False


@dataclass(frozen=True, slots=True)
class Session:
    """A session folder opened for reading; `SessionError` names what is missing."""

    folder: Path
    info: SessionInfo
    _stamps: dict[tuple[str, int], int]

    @classmethod
    def open(cls, folder: str | Path) -> Session:
        """Open a session folder."""
        folder = Path(folder)
        path = folder / "session.toml"
        if not os.path.isfile(path):
            raise SessionError(f"{folder} is no session: session.toml is missing; make one with `prismstereo simulate`")
        if path.stat().st_size > _MOST_BYTES:
            raise SessionError(f"{path} has {path.stat().st_size} bytes: a session.toml has at most {_MOST_BYTES}")
        try:
            info = msgspec.toml.decode(path.read_bytes(), type=SessionInfo)
        except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise SessionError(f"{path} cannot be understood: {error}: copy the session again") from error
        return cls(folder, info, _read_stamps(folder / "timestamps.csv"))

    def paths(self, kind: Kind) -> list[Path]:
        """Return the picture files of a kind, in order of their numbers; `SessionError` when some of them are gone."""
        found = [
            p for p in (self.folder / kind).glob("*") if p.suffix in (".png", ".jpg") and _NUMBER.fullmatch(p.stem)
        ]
        counts: dict[Kind, int] = {
            "video": self.info.video_frames,
            "stills": self.info.still_frames,
            "boards": self.info.board_frames,
            "boards_still": self.info.board_still_frames,
        }
        if len(found) < counts[kind]:
            raise SessionError(
                f"{self.folder / kind} holds {len(found)} of the {counts[kind]} pictures that session.toml counts: "
                "copy the session again"
            )
        return sorted(found, key=lambda path: int(path.stem))

    def frames(self, kind: Kind = "video") -> Iterator[RawFrame]:
        """Read the raw frames of a kind, one at a time, in order; `SessionError` for one without a time."""
        for path in self.paths(kind):
            index = int(path.stem)
            stamp = self._stamps.get((kind, index))
            if stamp is None:
                raise SessionError(
                    f"{self.folder / 'timestamps.csv'} has no time for {path.name} of {kind}: add the line "
                    f"{kind},{index},MICROSECONDS"
                )
            yield RawFrame(read_picture(path), index, stamp)

    @property
    def calibration_path(self) -> Path | None:
        """The calibration that lies in the folder, if there is one."""
        path = self.folder / "calibration.json"
        return path if path.is_file() else None

    def truth(self, index: int) -> Truth:
        """Read the truth behind video frame `index`; `SessionError` where the session has none."""
        base = self.folder / "truth"
        if not self.info.truth:
            raise SessionError(f"{self.folder} holds no truth: only sessions of the optical twin do")
        try:
            match = read_array(base / "match" / f"{index:06d}.npy")
            depth = pfm.read(base / "depth" / f"{index:06d}.pfm")
            occluded = read_picture(base / "occluded" / f"{index:06d}.png", grey=True) > 0
            objects = read_picture(base / "objects" / f"{index:06d}.png", grey=True)
        except DataError as error:
            raise SessionError(f"{self.folder} holds no readable truth of frame {index}: {error}") from error
        if (
            match.dtype != np.float32
            or match.shape != (*depth.shape, 2)
            or not depth.shape == occluded.shape == objects.shape
        ):
            raise SessionError(
                f"{self.folder}: the truth of frame {index} contradicts itself, depth {depth.shape}, match {match.dtype} "
                f"{match.shape}, occluded {occluded.shape}, objects {objects.shape}: copy the session again"
            )
        return Truth(depth_mm=depth, match_px=match.astype(np.float32, copy=False), occluded=occluded, objects=objects)


def _read_stamps(path: Path) -> dict[tuple[str, int], int]:
    if not path.is_file():
        return {}
    try:
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(f"{path} cannot be read: {error}: copy the session again") from error
    stamps: dict[tuple[str, int], int] = {}
    for number, line in enumerate(lines[1:], start=2):
        try:
            if line:
                kind, index, stamp = line.split(",")
                stamps[kind, int(index)] = int(stamp)
        except ValueError as error:
            raise SessionError(f"{path}, line {number}: {error}: each line is kind,index,microseconds") from error
    return stamps


class SessionWriter:
    """Writes a session folder piece by piece; session.toml comes last, so a folder that has one is whole.

    `standing` is the rig as it really stood, where that is not what its file says: the truth tells of it.
    """

    def __init__(self, folder: str | Path, rig: Rig, scene: str = "", standing: Rig | None = None) -> None:
        self.folder = Path(folder)
        if any((self.folder / part).exists() for part in ("session.toml", *get_args(Kind), "truth")):
            raise DataError(
                f"{self.folder} already holds a session, or half of one: give another folder, or remove that one first"
            )
        self._rig, self._scene, self._standing = rig, scene, standing or rig
        self._stamps: list[tuple[str, int, int]] = []
        self._counts: dict[Kind, int] = dict.fromkeys(get_args(Kind), 0)
        self._truth = False

    def add(self, kind: Kind, frame: RawFrame) -> Path:
        """Write one raw frame."""
        path = self.folder / kind / f"{frame.index:06d}.png"
        write_whole(path, _png(frame.pixels))
        self._stamps.append((kind, frame.index, frame.timestamp_us))
        self._counts[kind] += 1
        return path

    def add_truth(self, index: int, truth: Truth) -> None:
        """Write the truth behind one video frame."""
        base, name = self.folder / "truth", f"{index:06d}"
        pfm.write(base / "depth" / f"{name}.pfm", truth.depth_mm)
        buffer = io.BytesIO()
        np.save(buffer, truth.match_px, allow_pickle=False)
        write_whole(base / "match" / f"{name}.npy", buffer.getvalue())
        write_whole(base / "occluded" / f"{name}.png", _png(truth.occluded.astype(np.uint8) * 255))
        write_whole(base / "objects" / f"{name}.png", _png(truth.objects))
        self._truth = True

    def finish(self, *, board: str = "", square_mm: float = 0.0) -> SessionInfo:
        """Write the time stamps, the true lens, the rig and, last, session.toml."""
        lines = ["kind,index,timestamp_us", *(f"{kind},{index},{stamp}" for kind, index, stamp in self._stamps)]
        write_whole(self.folder / "timestamps.csv", ("\n".join(lines) + "\n").encode())
        write_whole(self.folder / "rig.toml", self._rig.toml().encode())
        if self._truth:
            write_whole(self.folder / "truth" / "lens.toml", tomli_w.dumps(_true_lens(self._standing)).encode())
        video = self._rig.camera.video
        info = SessionInfo(
            schema="prismstereo-session/1",
            rig=self._rig.name,
            scene=self._scene,
            video_width=video.width,
            video_height=video.height,
            video_rate_hz=video.rate_hz,
            video_frames=self._counts["video"],
            still_frames=self._counts["stills"],
            board_frames=self._counts["boards"],
            board_still_frames=self._counts["boards_still"],
            board=board,
            square_mm=square_mm,
            truth=self._truth,
        )
        content = msgspec.to_builtins(info)
        if not info.board_still_frames:
            del content["board_still_frames"]  # a session without them can be read by versions that do not know them
        write_whole(self.folder / "session.toml", tomli_w.dumps(content).encode())
        return info


def _png(pixels: NDArray[np.uint8]) -> bytes:
    return bytes(cv2.imencode(".png", pixels)[1].tobytes())


def _true_lens(rig: Rig) -> dict[str, object]:
    """Describe the true lens (raw video pixels) and the virtual pinholes: X_right = R X_left + t, millimetres.

    Both view frames are those of the raw picture, so the frame of a mirrored view is left-handed.
    """
    lens, left, right = rig.lens(), sight(rig, "left"), sight(rig, "right")
    R, folded = right.R @ left.R.T, rig.folded("left")
    t = R @ left.view_from_rig(right.centre_mm)
    return {
        "focal_px": lens.fx_px,
        "cx_px": lens.cx_px,
        "cy_px": lens.cy_px,
        "distortion": list(lens.distortion),
        "closed_form": folded is not None,
        "plate_mm": folded.plate_mm if folded else 0.0,
        "plate_index": folded.index if folded else 1.0,
        "R_right_from_left": R.tolist(),
        "t_right_from_left_mm": (-t).tolist(),
        "baseline_mm": float(np.linalg.norm(t)),
        "left_centre_in_rig_mm": left.centre_mm.tolist(),
        "right_centre_in_rig_mm": right.centre_mm.tolist(),
    }
