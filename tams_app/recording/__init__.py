"""The session log: written live by `Recorder`, read back by `read_log`."""

from tams_app.recording.mcap_stream import Gap
from tams_app.recording.reader import read_log, read_records, read_ticks, read_video
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
    "read_log",
    "read_records",
    "read_reference",
    "read_ticks",
    "read_video",
]
