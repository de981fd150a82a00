"""A log as tables: which topics it has, and the messages of one, flat enough for a spreadsheet."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tams_app.errors import UnreadableLogError, not_one_of
from tams_app.recording.mcap_stream import McapStream
from tams_app.recording.topics import HEADER, PROFILE, TOPICS
from tams_app.units import NS_PER_S

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

TIME_COLUMN = "log_t_s"  # seconds since the session began
_OBJECT = b"{"[0]  # our own messages are JSON objects, those of Foxglove's schemas are binary


@dataclass(slots=True)
class TopicCount:
    """What a log has of one topic; times in seconds since the session began."""

    topic: str
    messages: int
    size_bytes: int
    first_s: float
    last_s: float


def topic_counts(path: Path) -> list[TopicCount]:
    """Every topic of the log at `path`, by name; UnreadableLogError if it is none of ours."""
    found: dict[str, TopicCount] = {}
    for topic, t_s, data in _messages(path):
        count = found.setdefault(topic, TopicCount(topic, 0, 0, t_s, t_s))
        count.messages += 1
        count.size_bytes += len(data)
        count.first_s, count.last_s = min(count.first_s, t_s), max(count.last_s, t_s)
    return [found[topic] for topic in sorted(found)]


def messages_of(path: Path, topic: str) -> Iterator[dict[str, Any]]:
    """The messages of one of our topics, with the log's time in seconds as first field.

    UnreadableLogError if there is no such topic, or if its messages are not JSON.
    """
    others: set[str] = set()
    found = False
    for name, t_s, data in _messages(path):
        others.add(name)
        if name != topic:
            continue
        if data[:1] != bytes((_OBJECT,)):
            raise UnreadableLogError(f"{topic} is binary, for viewers such as Foxglove")
        found = True
        yield {TIME_COLUMN: round(t_s, 6), **json.loads(data)}
    if not found and topic not in {known.name for known in TOPICS.values()}:
        raise UnreadableLogError(f"{path}: {not_one_of(topic, sorted(others))}")


def columns_of(path: Path, topic: str) -> list[str]:
    """The columns of a table of all messages of a topic; errors as of `messages_of`.

    Nested fields become columns such as `arm.tcp.position.0`.
    """
    columns: dict[str, None] = {TIME_COLUMN: None}
    for message in messages_of(path, topic):
        columns.update(dict.fromkeys(flat(message)))
    return list(columns)


def write_csv(path: Path, topic: str, columns: list[str], out: SupportsWrite[str]) -> int:
    """The messages of a topic as rows of the columns that it has; how many."""
    rows = csv.DictWriter(out, columns, restval="")
    rows.writeheader()
    number = 0
    for message in messages_of(path, topic):
        rows.writerow(flat(message))
        number += 1
    return number


def flat(value: Any, name: str = "") -> dict[str, Any]:
    """Nested mappings and lists as one mapping, by path; null is an empty cell."""
    if isinstance(value, Mapping):
        parts = value.items()
    elif isinstance(value, list):
        parts = enumerate(value)  # type: ignore[assignment]
    else:
        return {name: "" if value is None else value}
    cells: dict[str, Any] = {}
    for key, part in parts:
        cells.update(flat(part, f"{name}.{key}" if name else str(key)))
    return cells


def _messages(path: Path) -> Iterator[tuple[str, float, bytes]]:
    """Topic, seconds since the session began, bytes; as far as the log is whole."""
    began_ns: int | None = None
    for topic, message in McapStream(path, PROFILE):
        if topic == HEADER.name:
            header = HEADER.decode(message.data)
            began_ns = header.started_ns + header.wall_offset_ns
        if began_ns is None:
            break
        yield topic, (message.log_time - began_ns) / NS_PER_S, message.data
    if began_ns is None:
        raise UnreadableLogError(
            f"{path}: holds no session header; the session ended before it began"
        )
