"""Recordings: MCAP files of every packet that a camera sent, that survive a power cut, and replay as the camera itself."""

from __future__ import annotations

from prismstereo.recording.chunk import Damage
from prismstereo.recording.errors import RecordingError
from prismstereo.recording.place import RecordingFolder
from prismstereo.recording.recorder import Recorder, RecorderStatistics
from prismstereo.recording.recording import Recording, StoredCalibration
from prismstereo.recording.recording_link import RecordingLink
from prismstereo.recording.recovery import Recovered, recover
from prismstereo.recording.replaying import no_other, replay

__all__ = [
    "Damage",
    "Recorder",
    "RecorderStatistics",
    "Recording",
    "RecordingError",
    "RecordingFolder",
    "RecordingLink",
    "Recovered",
    "StoredCalibration",
    "no_other",
    "recover",
    "replay",
]
