"""The keys that a configuration file marks SET: those left as in ours, and a copy with values."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import yaml
from yaml.nodes import MappingNode, Node

from tams_app.config.yaml_file import CONFIG_DIRECTORY

TEMPLATE = CONFIG_DIRECTORY / "lite6.yaml"
"""The file to copy: every key that depends on the place is marked in it."""

_MARK = re.compile(r"# *SET\b[:,]? *")


def unset_keys(path: Path) -> dict[str, int]:
    """The keys that are marked in the file and have the template's value, each with its line.

    A mark is a comment that begins with SET, behind the value or right above the key. The
    file has been read by `load_config` before.
    """
    ours = {key: _plain(value) for key, _, value in _entries(TEMPLATE.read_text(encoding="utf-8"))}
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    return {
        key: name.start_mark.line + 1
        for key, name, value in _entries(text)
        if ours.get(key) == _plain(value) and _is_marked(lines, name, value)
    }


def filled(text: str, values: Mapping[str, tuple[str, str]]) -> str:
    """`text` with new values of dotted keys; its comments stay, but for the marks of these keys.

    values: by dotted key, what its last part becomes, and the value in YAML.
    """
    places = {key: (name, value) for key, name, value in _entries(text)}
    for key in sorted(values, key=lambda one: places[one][0].start_mark.index, reverse=True):
        name, value = places[key]
        end = value.end_mark.index
        comment, newline, rest = text[end:].partition("\n")
        comment = re.sub(r" *# *$", "", _MARK.sub("# ", comment))
        text = f"{text[: name.start_mark.index]}{': '.join(values[key])}{comment}{newline}{rest}"
    return text


def _entries(text: str) -> Iterator[tuple[str, Node, Node]]:
    """Each dotted key that has a value of its own, with the nodes of its last part and value."""
    whole = yaml.compose(text, yaml.SafeLoader)
    if isinstance(whole, MappingNode):
        yield from _within(whole, "")


def _within(mapping: MappingNode, prefix: str) -> Iterator[tuple[str, Node, Node]]:
    for name, value in mapping.value:
        if isinstance(value, MappingNode):
            yield from _within(value, f"{prefix}{name.value}.")
        else:
            yield f"{prefix}{name.value}", name, value


def _plain(value: Node) -> object:
    return [_plain(one) for one in value.value] if isinstance(value.value, list) else value.value


def _is_marked(lines: list[str], name: Node, value: Node) -> bool:
    if _MARK.match(lines[value.end_mark.line][value.end_mark.column :].lstrip()):
        return True
    above = name.start_mark.line - 1
    while above >= 0 and lines[above].lstrip().startswith("#"):
        if _MARK.match(lines[above].lstrip()):
            return True
        above -= 1
    return False
