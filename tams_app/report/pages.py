"""The page kit: how pages of sessions and studies are made, and how they write numbers and names.

What is not known is a dash; a value's interval stands behind it in brackets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from tams_app.records import Phase
from tams_app.report.plots import THEME

_SHARED = Path(__file__).parent  # page.html.j2: head and style; parts.html.j2: table, figure, tiles
NONE = "–"
_NAMES = {"tams": "TAMS", "equal": "Equal", "static": "Static"}


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its interval over `n` units; both ends None where n is too small for one."""

    value: float
    low: float | None
    high: float | None
    n: int


def name(key: str) -> str:
    """A strategy's or network's name in print."""
    return _NAMES.get(key, key.upper())


def term_name(term: str) -> str:
    """A model term's name in print."""
    parts = term.split(" × ")
    return " × ".join(part.lower() if part == "Intercept" else name(part) for part in parts)


def phase_name(phase: str) -> str:
    return Phase(phase).word


def number(value: float | None, digits: int = 0, signed: bool = False, unit: str = "") -> str:
    """With a true minus sign, and with its unit; a dash where there is none."""
    if value is None:
        return NONE
    text = f"{value:+.{digits}f}" if signed else f"{value:.{digits}f}"
    if float(text) == 0:
        text = text.replace("-", "").replace("+", "")
    return text.replace("-", "−") + (f" {unit}" if unit else "")


def interval(estimate: Estimate | None, digits: int, signed: bool = False) -> str:
    """Value and interval: `0.944 [0.940, 0.948]`."""
    if estimate is None:
        return NONE
    value = number(estimate.value, digits, signed)
    if estimate.low is None or estimate.high is None:
        return f"{value} [no interval, n = {estimate.n}]"
    return (
        f"{value} [{number(estimate.low, digits, signed)}, {number(estimate.high, digits, signed)}]"
    )


def value(estimate: Estimate | None, digits: int) -> str:
    """The value without its interval."""
    return number(estimate.value if estimate else None, digits)


def percent(estimate: Estimate | None) -> str:
    """A share with its interval in percent."""
    if estimate is None or estimate.low is None or estimate.high is None:
        return NONE
    return f"{100 * estimate.value:.0f} % [{100 * estimate.low:.0f}, {100 * estimate.high:.0f}]"


def counted(count: int, noun: str) -> str:
    """`1 trial`, `2 trials`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def prefixed(text: str, prefix: str) -> str:
    return f"{prefix}{text}"


def p_value(p: float) -> str:
    if p < 0.001:
        return "p < .001"
    return "p > .999" if p > 0.999 else f"p = {p:.3f}".replace("0.", ".", 1)


def listed(words: Sequence[str]) -> str:
    """`a, b and c`."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


_WORDS: tuple[Any, ...] = (
    name,
    term_name,
    phase_name,
    number,
    interval,
    value,
    percent,
    counted,
    prefixed,
    p_value,
    listed,
)


def page_environment(directory: Path = _SHARED) -> jinja2.Environment:
    """For the templates in `directory`: values are escaped, one that is missing is an error.

    What this module writes is there as filters and as functions.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([directory, _SHARED]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    words = {one.__name__: one for one in _WORDS}
    environment.filters |= words
    environment.globals |= {**words, "theme": THEME}
    return environment
