"""The session log: written live by `Recorder`, read back by `read_log`."""

from tams_app.recording.mcap_stream import Gap, damage_sentence
from tams_app.recording.reader import damage_of, read_log, read_records, read_ticks, read_video
from tams_app.recording.reference import ReferenceRecorder, read_reference
from tams_app.recording.topics import (
    LOG_NAME,
    Facts,
    FrameCaptured,
    FrameSent,
    FrameShown,
    Header,
    SessionLog,
)
from tams_app.recording.viewers import MakeViewers, Viewers
from tams_app.recording.writer import Recorder

__all__ = [
    "LOG_NAME",
    "Facts",
    "FrameCaptured",
    "FrameSent",
    "FrameShown",
    "Gap",
    "Header",
    "MakeViewers",
    "Recorder",
    "ReferenceRecorder",
    "SessionLog",
    "Viewers",
    "damage_of",
    "damage_sentence",
    "read_log",
    "read_records",
    "read_reference",
    "read_ticks",
    "read_video",
]
