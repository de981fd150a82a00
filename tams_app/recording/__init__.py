"""The session log: written live by `Recorder`, read back by `read_log`."""

from tams_app.recording.journal import Recorder as Recorder
from tams_app.recording.mcap_log import Viewer as Viewer
from tams_app.recording.mcap_stream import Gap as Gap
from tams_app.recording.mcap_stream import damage_sentence as damage_sentence
from tams_app.recording.reader import damage_of as damage_of
from tams_app.recording.reader import read_log as read_log
from tams_app.recording.reader import read_records as read_records
from tams_app.recording.reader import read_ticks as read_ticks
from tams_app.recording.reader import read_video as read_video
from tams_app.recording.reference import ReferenceRecorder as ReferenceRecorder
from tams_app.recording.reference import read_reference as read_reference
from tams_app.recording.topics import LOG_NAME as LOG_NAME
from tams_app.recording.topics import Facts as Facts
from tams_app.recording.topics import FrameCaptured as FrameCaptured
from tams_app.recording.topics import FrameSent as FrameSent
from tams_app.recording.topics import FrameShown as FrameShown
from tams_app.recording.topics import Header as Header
from tams_app.recording.topics import SessionLog as SessionLog
