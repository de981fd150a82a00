"""The base of every section of the configuration, and the mistakes in one: a sentence for each."""

from __future__ import annotations

import math
import re
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from difflib import get_close_matches
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator
from pydantic_core import ErrorDetails

from tams_app.errors import not_one_of

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
WORD = r"^[A-Za-z0-9_+-]+$"
Word = Annotated[str, Field(pattern=WORD)]  # names one of several kinds
Port = Annotated[int, Field(ge=0, le=65535)]
Triple = tuple[Finite, Finite, Finite]
Six = tuple[Finite, Finite, Finite, Finite, Finite, Finite]
_LONGEST_VALUE = 60
_MOST_REPORTED = 50
# What a configuration of one's own usually includes.
_INCLUDED = {
    "networks": "networks.yaml",
    "policy": "weights.yaml",
    "policy.weights": "weights.yaml",
}


class Section(BaseModel):
    """A part of the configuration: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _what_yaml_takes_for_something_else(cls, value: Any, info: ValidationInfo) -> Any:
        """`yes` is no number, and 0123 no text: YAML has read it as 83 by now."""
        assert info.field_name is not None
        kind = cls.model_fields[info.field_name].annotation
        if isinstance(value, bool) and kind in (int, float):
            raise ValueError("must be a number")
        if kind is str and isinstance(value, int | float | date):
            raise ValueError("must be text: write it in quotes")
        return value

    def require_order(self, *pairs: tuple[str, str]) -> None:
        """ValueError unless the value of the first key of each pair is smaller."""
        for less, more in pairs:
            if getattr(self, less) >= getattr(self, more):
                raise ValueError(f"{less} must be smaller than {more}")


@dataclass(frozen=True, slots=True)
class Problem:
    """A dotted key, "" for the whole, and what is wrong with it."""

    key: str
    reason: str

    def __str__(self) -> str:
        return f"{self.key}: {self.reason}" if self.key else self.reason


def find_problems(error: ValidationError, model: type[BaseModel]) -> list[Problem]:
    """All mistakes, unknown keys first, for they may explain the rest; at most 50 are named.

    `model`: whose keys an unknown one is compared with, for what may have been meant.
    """
    details = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    problems = [Problem(_key(one), _reason(one, model)) for one in details[:_MOST_REPORTED]]
    more = len(details) - len(problems)
    return [*problems, Problem("", f"and {more} more")] if more else problems


def describe_validation_error(error: ValidationError, model: type[BaseModel]) -> str:
    """All that is wrong, in one line."""
    return "; ".join(map(str, find_problems(error, model)))


def sections(hint: Any) -> Iterator[type[BaseModel]]:
    """The models in a type such as `X`, `X | None` or `dict[str, X]`."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
    for part in typing.get_args(hint):
        yield from sections(part)


def _key(detail: ErrorDetails) -> str:
    return ".".join(str(part) for part in detail["loc"] if part != "[key]")  # for a wrong key


def _reason(detail: ErrorDetails, model: type[BaseModel]) -> str:
    key, kind = _key(detail), detail["type"]
    if kind == "missing":
        file = _INCLUDED.get(key)
        return f"is missing; `include: [{file}]` brings ours" if file else "is missing"
    if kind == "extra_forbidden":
        meant = _meant(detail, model)
        reason = f"no such key, did you mean {meant}?" if meant else "no such key"
    elif kind in ("literal_error", "enum") and isinstance(detail["input"], str):
        return not_one_of(detail["input"], re.findall("'([^']*)'", detail["ctx"]["expected"]))
    elif kind == "model_type":
        reason = "must hold keys and values"
    else:
        message = detail["msg"].removeprefix("Value error, ")
        reason = re.sub(r"^\w+ should ", "must ", message)
    value = _shown(detail["input"])
    return f"{reason} (given: {value})" if value else reason


def _shown(value: Any) -> str:
    """A value as it is written in YAML; nothing if it is long."""
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "infinity" if value > 0 else "-infinity"
    if isinstance(value, dict):
        return ""
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    text = repr(value).removesuffix(".0") if isinstance(value, float) else repr(value)
    return text if len(text) <= _LONGEST_VALUE else ""


def _meant(detail: ErrorDetails, model: type[BaseModel]) -> str:
    """The key that an unknown one was probably meant to be, or ""."""
    *path, name = map(str, detail["loc"])
    section: type[BaseModel] | None = model
    for part in path:
        field = section.model_fields.get(part) if section else None
        # what is no field is the name of an entry, as in networks.s1
        section = next(sections(field.annotation), None) if field else section
    beside = [*section.model_fields, *([] if path else ["include"])] if section else []
    if close := get_close_matches(name, beside, 1):
        return ".".join((*path, close[0]))
    return next((key for key in _keys(model, "") if key.split(".")[-1] == name), "")


def _keys(model: type[BaseModel], prefix: str) -> Iterator[str]:
    """Every dotted key outside of named entries."""
    for name, field in model.model_fields.items():
        yield prefix + name
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _keys(field.annotation, f"{prefix}{name}.")
