"""What fuzzing begins with: small valid inputs of every target."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from hypothesis import find

from tams_app.link.messages import encode
from tams_app.recording.mcap_stream import McapStream
from tams_app.recording.topics import PROFILE
from tests.fuzzing.targets import RECORDS
from tests.link.test_messages import hands, states, welcomes

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "tests" / "data" / "golden-feedback.mcap"
_KEPT_BYTES = 60_000  # of a log, which is then one that was cut off
_COURSES = (b"\0\3abc\1\0\2\0\3\1\x64\2\0", b"\1\2\0\xff\1\2\x09\1\3\1\xff\3\1\xff", b"\0\1\xc1")


def _configurations() -> Iterator[bytes]:
    for file in sorted((ROOT / "config").glob("*.yaml")):
        yield file.read_bytes()
    yield b"version: 1\nlimits: &l {max_speed_mm_s: 100}\n"


def _logs() -> Iterator[bytes]:
    yield LOG.read_bytes()[:_KEPT_BYTES]


def _records() -> Iterator[bytes]:
    numbers = {topic.name: number for number, topic in enumerate(RECORDS)}
    seen: set[str] = set()
    for name, message in islice(McapStream(LOG, PROFILE), 5000):
        if name in numbers and name not in seen:
            seen.add(name)
            yield bytes((numbers[name],)) + message.data


def _messages() -> Iterator[bytes]:
    for kind in (welcomes, hands, states):
        yield encode(find(kind, lambda _: True))


def _courses() -> Iterator[bytes]:
    yield from _COURSES


_SEEDS: dict[str, Callable[[], Iterator[bytes]]] = {
    "authentic": _courses,
    "channel": _courses,
    "configuration": _configurations,
    "handshake": _courses,
    "log": _logs,
    "messages": _messages,
    "operator-end": _courses,
    "records": _records,
    "robot-end": _courses,
}


def seeds_of(target: str) -> list[bytes]:
    """Small valid inputs of a target."""
    return list(_SEEDS[target]())
