"""The reference of the configuration, made from the models: `config --explain KEY`.

The meaning of a key is the string below it in the model's source. It is read from there and not
by pydantic, which would parse the source in every process that starts.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
import typing
from collections.abc import Iterator
from datetime import date
from difflib import get_close_matches
from enum import Enum
from typing import Annotated, Any

import typer
from annotated_types import BaseMetadata
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tams_app.config.section import WORD, sections
from tams_app.config.whole import REMOVED, Config
from tams_app.errors import ConfigError

_HEAD = """\
# Configuration

Every key of a configuration file, made from the models in `tams_app/config/` by
`run_tams.py config --explain all`. A file needs `version`, `policy` and `networks` (the last
two usually by `include: [networks.yaml, weights.yaml]`); every other key has a default. Numbers are
finite; the end of a name tells its unit (`_mm_s`, `_kbps`). `config/lite6.yaml` shows what hardware
needs, docs/OPERATOR.md how to fill it in.
"""
_UNITS = {
    "mm_deg": "mm, °",
    "rad_s3": "rad/s³",
    "rad_s2": "rad/s²",
    "rad_s": "rad/s",
    "mm_s": "mm/s",
    "deg_s": "°/s",
    "m_s3": "m/s³",
    "m_s2": "m/s²",
    "m_s": "m/s",
    "per_s": "1/s",
    "rad": "rad",
    "deg": "°",
    "mm": "mm",
    "ms": "ms",
    "us": "µs",
    "s": "s",
    "m": "m",
    "hz": "Hz",
    "kbps": "kbit/s",
    "bytes": "bytes",
    "kg": "kg",
    "mb": "MB",
    "px": "px",
    "fx": "px",
    "fy": "px",
    "cx": "px",
    "cy": "px",
    "k": "K",
    "width": "px",
    "height": "px",
    "fps": "1/s",
}
_SIGNS = {"gt": "> ", "ge": "≥ ", "lt": "< ", "le": "≤ ", "multiple_of": "a multiple of "}
_WORDS = {
    int: "whole number",
    float: "number",
    str: "text",
    bool: "true, false",
    date: "a day",
}


def config(
    key: Annotated[
        str,
        typer.Option(
            "--explain", metavar="KEY", help="A key or a section, such as link; all: every key."
        ),
    ],
) -> None:
    """Print what a key means, its default and what it may be."""
    typer.echo(explain(key), nl=False)


def reference() -> str:
    """The whole document."""
    return "\n".join([_HEAD, *(_table(key, model) for key, model in all_sections(Config, ""))])


def explain(key: str) -> str:
    """The meaning of a key, a section as a table, or everything; ConfigError for an unknown key."""
    if key == "all":
        return reference()
    keys = {}
    for place, model in all_sections(Config, ""):
        if place and _is_named(place, key):
            return _table(place, model)
        for name in model.model_fields:
            keys[f"{place}.{name}".removeprefix(".")] = model
    for place, model in keys.items():
        if _is_named(place, key):
            name = place.rpartition(".")[2]
            field = model.model_fields[name]
            means = f"{key}: {meaning(model, name)}\n"
            unit, default, allowed = _unit(name), _default(field), _allowed(field)
            return f"{means}Default: {default}. Allowed: {allowed}. Unit: {unit}.\n"
    if instead := REMOVED.get(key):
        raise ConfigError(f"--explain: {key}: {instead}")
    close = get_close_matches(key, keys, 1)
    meant = f"did you mean {close[0]}?" if close else "`all` prints every key"
    raise ConfigError(f"--explain: {key}: no such key, {meant}")


def _is_named(place: str, key: str) -> bool:
    """True if `place` is that of a dotted key, where NAME stands for any name."""
    parts, given = place.split("."), key.split(".")
    return len(parts) == len(given) and all(
        part in ("NAME", one) for part, one in zip(parts, given, strict=True)
    )


def meaning(model: type[BaseModel], name: str) -> str:
    """The string below a key, or the docstring of the section that it holds; "" if neither is."""
    for owner in model.__mro__:
        if found := _meanings(owner).get(name):
            return found
    hint = model.model_fields[name].annotation
    return _first_paragraph(next(sections(hint), None)) if _is_section(hint) else ""


def all_sections(model: type[BaseModel], key: str) -> Iterator[tuple[str, type[BaseModel]]]:
    """Each section below `key`, itself first: dotted key and model."""
    yield key, model
    for name, field in model.model_fields.items():
        named = "" if _is_one(field.annotation) else ".NAME"
        for inner in sections(field.annotation):
            yield from all_sections(inner, f"{key}.{name}{named}".removeprefix("."))


def _table(key: str, model: type[BaseModel]) -> str:
    heading = f"## `{key}`" if key else "## The top of the file"
    rows = [
        f"| `{name}` | {_unit(name)} | {_default(field)} | {_allowed(field)} "
        f"| {meaning(model, name)} |"
        for name, field in model.model_fields.items()
    ]
    columns = "| Key | Unit | Default | Allowed | Meaning |\n|---|---|---|---|---|"
    return "\n".join([heading, "", _first_paragraph(model), "", columns, *rows, ""])


def _is_section(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, BaseModel)


def _is_one(hint: Any) -> bool:
    """True if the hint is of a section, or of a section or null."""
    parts = typing.get_args(hint)
    return _is_section(hint) or (type(None) in parts and any(map(_is_section, parts)))


def _first_paragraph(model: type | None) -> str:
    return " ".join((inspect.getdoc(model) or "").split("\n\n")[0].split())


def _meanings(owner: type) -> dict[str, str]:
    """The strings below the fields of one class."""
    if not (issubclass(owner, BaseModel) and owner.__module__.startswith("tams_app.")):
        return {}
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
    assert isinstance(body, ast.ClassDef)
    return {
        field.target.id: " ".join(str(below.value.value).split())
        for field, below in zip(body.body, body.body[1:], strict=False)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
    }


def _unit(name: str) -> str:
    return next((unit for end, unit in _UNITS.items() if f"_{name}".endswith(f"_{end}")), "–")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.get_default(call_default_factory=True)
    return "below" if isinstance(value, BaseModel) else f"`{_yaml(value)}`"


def _yaml(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, tuple):
        return f"[{', '.join(map(_yaml, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_yaml(one)}" for key, one in value.items()) + "}"
    return f"{value:g}" if isinstance(value, float) else str(value) or '""'


def _allowed(field: FieldInfo) -> str:
    return _bounded(field.annotation, field.metadata)


def _bounded(hint: Any, metadata: list[Any]) -> str:
    whole = "whole number, " if hint is int else ""
    bounds = _bounds(metadata)
    return whole + bounds if bounds else _type(hint)


def _bounds(metadata: list[Any]) -> str:
    """The bounds that pydantic checks, in signs; "" if there are none."""
    found = []
    for one in metadata:
        if isinstance(one, BaseMetadata):
            found += [
                f"{_SIGNS[key]}{getattr(one, key):.10g}" for key in _SIGNS if hasattr(one, key)
            ]
        if pattern := getattr(one, "pattern", None):
            found.append("a word" if pattern == WORD else f"`{pattern}`")
    return ", ".join(found)


def _type(hint: Any) -> str:
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return _bounded(parts[0], [*getattr(parts[1], "metadata", parts[1:])])
    if origin is typing.Literal:
        return ", ".join(f"`{part}`" for part in parts)
    if origin is tuple:
        many = "" if parts[-1] is ... else f"{len(parts)} × "
        return many + _type(parts[0]) + ("s" if parts[-1] is ... else "")
    if origin is dict:
        return f"{_type(parts[0])}: {_type(parts[1])}"
    if type(None) in parts:
        return f"{_type(parts[0])}, or null"
    if _is_section(hint):
        return "a section"
    if isinstance(hint, type) and issubclass(hint, Enum):
        return ", ".join(f"`{member.value}`" for member in hint)
    return _WORDS.get(hint, "")
