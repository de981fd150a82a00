"""The reference of the log's fields, made from the records: `log fields`.

The rows are those of the JSON schemas that lie in every log.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator
from typing import Any

from tams_app.errors import ConfigError, not_one_of
from tams_app.recording.rates import RATES
from tams_app.recording.topics import TOPICS, Topic

_HEAD = """\
# The fields of the log

Every field of each topic whose messages are JSON, made from the records in `tams_app/records/`,
`tams_app/recording/topics.py` and `tams_app/recording/rates.py` by `run_tams.py log fields`.
[LOG.md](LOG.md#topics) says what a topic has a message for, and the conventions of units, frames
and clocks. *By name*: an object with a value for each name, such as each view. Fields behind a dot
are those of the object, or of each object of the list.
"""
_WORDS = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true, false",
    "string": "text",
    "object": "object",
}


def reference(topic: str = "") -> str:
    """The whole document, or the table of one topic; ConfigError for one that has none."""
    topics = {topic.name: topic for topic in (*TOPICS.values(), RATES)}
    if topic:
        if topic not in topics:
            raise ConfigError(f"TOPIC: {not_one_of(topic, topics)}")
        return _table(topics[topic])
    return "\n".join([_HEAD, *map(_table, topics.values())])


def _table(topic: Topic[Any]) -> str:
    rows = [
        f"| `{name}` | {_type(part)} | {part['description']} |"
        for name, part in _parts(json.loads(topic.schema()))
    ]
    about = " ".join((inspect.getdoc(topic.record_type) or "").split("\n\n")[0].split())
    columns = "| Field | Type | Meaning |\n|---|---|---|"
    return "\n".join([f"## `{topic.name}`", "", about, "", columns, *rows, ""])


def _parts(schema: dict[str, Any], before: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Each field with its dotted name, an object's own behind it."""
    for name, part in schema.get("properties", {}).items():
        yield before + name, part
        yield from _parts(part.get("items", part), f"{before}{name}.")


def _type(schema: dict[str, Any]) -> str:
    if items := schema.get("items"):
        return f"list: {_type(items)}"
    if values := schema.get("additionalProperties"):
        return f"by name: {_type(values)}"
    if values := schema.get("enum"):
        return ", ".join(f"`{value}`" if value else "empty" for value in values)
    return _WORDS[schema["type"]]
