"""A recording in the place of the camera, that can stand still and be moved to any moment."""

from __future__ import annotations

from pathlib import Path

from prismstereo.driver import StereoCamera
from prismstereo.recording import RecordingLink, no_other

__all__ = ["Playback"]


class Playback:
    """The recording at `path`; RecordingError where it is none. Whoever opens its camera owns it from then on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._link = RecordingLink(path, stay=True)

    @property
    def name(self) -> str:
        """The file's name."""
        return self.path.name

    def open(self) -> StereoCamera:
        """Play it as if its camera were here; LinkLost where it does not meet."""
        try:
            return StereoCamera(self._link, reopen=no_other)
        except BaseException:
            self._link.close()
            raise

    def again(self) -> Playback:
        """Open the same recording once more, where this one was."""
        other = Playback(self.path)
        other.move(self._link.position_s)
        return other

    def move(self, position_s: float) -> None:
        """Go to so many seconds after the beginning."""
        self._link.seek(position_s)

    def pause(self, *, on: bool) -> None:
        """Stand still, or go on."""
        if on:
            self._link.pause()
        else:
            self._link.resume()

    def told(self) -> dict[str, object]:
        """Tell the page which recording it is, and which moment of it is shown."""
        link = self._link
        return {
            "name": self.name,
            "position_s": round(link.position_s, 2),
            "length_s": round(link.length_s, 2),
            "paused": link.paused,
            "cut": link.recording.why_cut,
        }
