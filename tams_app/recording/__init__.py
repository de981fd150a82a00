"""The session log: written live by `Recorder`, read back by `read_log`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tams_app.recording.journal import Recorder as Recorder
from tams_app.recording.mcap_log import Viewer as Viewer
from tams_app.recording.topics import LOG_NAME as LOG_NAME
from tams_app.recording.topics import Facts as Facts
from tams_app.recording.topics import FrameCaptured as FrameCaptured
from tams_app.recording.topics import FrameSent as FrameSent
from tams_app.recording.topics import FrameShown as FrameShown
from tams_app.recording.topics import Gap as Gap
from tams_app.recording.topics import Header as Header
from tams_app.recording.topics import SessionLog as SessionLog
from tams_app.recording.topics import damage_sentence as damage_sentence

if TYPE_CHECKING:
    from tams_app.recording.reader import damage_of as damage_of
    from tams_app.recording.reader import read_log as read_log
    from tams_app.recording.reader import read_records as read_records
    from tams_app.recording.reader import read_ticks as read_ticks
    from tams_app.recording.reader import read_video as read_video

_READER = ("damage_of", "read_log", "read_records", "read_ticks", "read_video")


def __getattr__(name: str) -> Any:
    """Load the reader for those who read: a session only writes."""
    if name in _READER:
        return getattr(import_module("tams_app.recording.reader"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
