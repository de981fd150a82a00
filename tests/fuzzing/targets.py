"""What reads bytes of foreign origin, each as one function that hypothesis and a fuzzer can call.

A target takes any bytes. What it may raise is caught within it: an exception that leaves a target,
or an assertion, is a finding.
"""

from __future__ import annotations

import resource
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from tams_app.config import load_config
from tams_app.errors import ConfigError, UnreadableLogError
from tams_app.link.messages import (
    HandMessage,
    MessageError,
    SessionDescription,
    StateMessage,
    decode,
    encode,
)
from tams_app.recording.reader import read_log, read_records
from tams_app.recording.topics import TOPICS
from tests.fuzzing import link

MESSAGES = (SessionDescription, HandMessage, StateMessage)
RECORDS = tuple(TOPICS.values())
MEMORY_BYTES = 1 << 30  # more than this for a short input is a finding


@cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="tams-fuzzing-"))


def messages(data: bytes) -> None:
    """What the applications of the two sides send each other."""
    for kind in MESSAGES:
        with suppress(MessageError):
            message = decode(data, kind)
            assert decode(encode(message), kind) == message or data.find(b"\xcb") >= 0  # a NaN


def records(data: bytes) -> None:
    """One record of the log: the first byte chooses its topic."""
    if data:
        topic = RECORDS[data[0] % len(RECORDS)]
        # what `recording.reader` takes for a record of another version
        with suppress(AttributeError, KeyError, TypeError, ValueError):
            topic.decode(data[1:])


def log(data: bytes) -> None:
    """A whole file that claims to be a log."""
    path = _folder() / "session.mcap"
    path.write_bytes(data)
    with suppress(UnreadableLogError):
        read_log(path)
    with suppress(UnreadableLogError):
        for _ in read_records(path):
            pass


def configuration(data: bytes) -> None:
    """A configuration file."""
    path = _folder() / "config.yaml"
    path.write_bytes(data)
    with suppress(ConfigError), bounded_memory():
        load_config(path)


@contextmanager
def bounded_memory() -> Iterator[None]:
    """No more than MEMORY_BYTES of memory beyond what the process has by now."""
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    assert grown_kb * 1024 < MEMORY_BYTES, f"{grown_kb} kB more"


TARGETS: dict[str, Callable[[bytes], None]] = {
    "authentic": link.authentic,
    "channel": link.channel,
    "configuration": configuration,
    "handshake": link.handshake,
    "log": log,
    "messages": messages,
    "operator-end": link.operator_end,
    "records": records,
    "robot-end": link.robot_end,
}
