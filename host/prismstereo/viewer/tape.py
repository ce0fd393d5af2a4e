"""A recording that is being made, with the streams that it needs."""

from __future__ import annotations

from contextlib import ExitStack

from prismstereo.driver import StereoCamera
from prismstereo.recording import Recorder
from prismstereo.viewer.records import Records
from prismstereo.viewer.switches import Switches

__all__ = ["Tape"]


class Tape:
    """Records a camera into the records' folder under a name of the recorder's own; with `raw` its raw frames too."""

    def __init__(self, camera: StereoCamera, records: Records, switches: Switches, *, raw: bool) -> None:
        self._stack = ExitStack()
        with ExitStack() as stack:
            if raw:
                stack.enter_context(switches.during("raw"))
            self._recorder = stack.enter_context(Recorder(camera, records.folder))
            self._stack = stack.pop_all()

    def told(self) -> dict[str, object]:
        """Tell its name, how long and how large it is, and why it ended by itself, if it has."""
        counts = self._recorder.statistics
        return {
            "name": self._recorder.path.name,
            "seconds": round(counts.seconds, 1),
            "bytes": counts.bytes,
            "dropped": counts.dropped,
            "problem": self._recorder.reason,
        }

    def close(self) -> None:
        """End it in good order."""
        self._stack.close()
