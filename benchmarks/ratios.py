"""From runs of two checkouts to ratios with their targets; pure arithmetic and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import Any

from rich.table import Table

LEAST_PAIRS = 3
MOST_OTHERS = 0.1  # of a core, by other programs: above it the machine counts as busy
MOST_ENGAGED_DIFFERENCE = 0.15  # of the ticks, between the sides of a pair
MOST_RATE_DIFFERENCE = 0.05  # of the frames given, between the sides of a pair


class Side(Enum):
    """Which checkout a run was of: the one compared with, or this one."""

    BEFORE = "before"
    AFTER = "after"


@dataclass(frozen=True, slots=True)
class Measure:
    """A figure of a run; `scale` makes the table's unit of it, `target` is the ratio at most."""

    key: str
    name: str
    unit: str
    scale: float = 1.0
    target: float | None = None
    is_cost: bool = True


_CORE = "% of a core"
MEASURES = (
    Measure("beyond_share", "application beyond video", _CORE, 100, 0.40),
    Measure("beyond_ms_per_frame", "the same, a frame", "ms"),
    Measure("beyond_with_operator_share", "the same with the operator", _CORE, 100),
    Measure("control_ms_per_tick", "control thread, a tick", "ms", target=0.35),
    Measure("rig_share", "rig", _CORE, 100, 0.50),
    Measure("set_ms", "renderer, a set of frames", "ms", target=0.65),
    Measure("virtual_cpu_s_per_s", "trial, a virtual second", "s", target=0.60),
    Measure("encoding_ms_per_frame", "encoding, a frame", "ms"),
    Measure("decoding_ms_per_frame", "decoding, a frame", "ms"),
    Measure("session_share", "application and helpers", _CORE, 100),
    Measure("fps_given", "frames given, a view", "/s", is_cost=False),
    Measure("engaged_share", "ticks with arm engaged", "%", 100, is_cost=False),
    Measure("late_share", "late ticks", "%", 100, is_cost=False),
    Measure("latency_p50_ms", "latency p50, worst view", "ms", is_cost=False),
    Measure("virtual_s", "length of the trial", "s", is_cost=False),
    Measure("others_share", "other programs", _CORE, 100, is_cost=False),
)


@dataclass(frozen=True, slots=True)
class Run:
    """One finished run of one side, with the figures that it gives."""

    pair: int
    side: Side
    measures: Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class Row:
    """A measure over all pairs that have it on both sides."""

    measure: Measure
    before: tuple[float, ...]
    after: tuple[float, ...]

    @property
    def ratios(self) -> tuple[float, ...]:
        """Of each pair, after to before; empty where a ratio says nothing."""
        if not self.measure.is_cost:
            return ()
        return tuple(
            after / before for before, after in zip(self.before, self.after, strict=True) if before
        )

    @property
    def verdict(self) -> str:
        """Of the median: met, missed, or "" where there is no target or no pair."""
        if self.measure.target is None or not self.ratios:
            return ""
        return "met" if median(self.ratios) <= self.measure.target else "missed"

    def as_json(self) -> dict[str, Any]:
        ratios = self.ratios
        return {
            "key": self.measure.key,
            "what": self.measure.name,
            "before": self.before,
            "after": self.after,
            "ratios": ratios,
            "ratio": {"min": min(ratios), "median": median(ratios), "max": max(ratios)}
            if ratios
            else None,
            "target": self.measure.target,
            "verdict": self.verdict,
        }


def turn(pair: int) -> tuple[Side, Side]:
    """Which side of a pair runs first: they take turns, so that a slow drift favours neither."""
    return (Side.AFTER, Side.BEFORE) if pair % 2 else (Side.BEFORE, Side.AFTER)


def rows(runs: Sequence[Run]) -> list[Row]:
    """Every measure of which there is a pair, in the table's order."""
    found = []
    for measure in MEASURES:
        values: dict[Side, dict[int, float]] = {side: {} for side in Side}
        for run in runs:
            value = run.measures.get(measure.key)
            if value is not None:
                values[run.side][run.pair] = value
        before, after = values[Side.BEFORE], values[Side.AFTER]
        both = sorted(before.keys() & after.keys())
        if both:
            found.append(
                Row(
                    measure,
                    tuple(before[pair] for pair in both),
                    tuple(after[pair] for pair in both),
                )
            )
    return found


def doubts(rows: Sequence[Row], pairs: int) -> list[str]:
    """What speaks against the ratios, in sentences: a busy machine, other rates, missing pairs."""
    told = [] if pairs >= LEAST_PAIRS else [f"Fewer than {LEAST_PAIRS} pairs: no verdict yet."]
    for row in rows:
        if row.measure.key == "others_share":
            worst = max(*row.before, *row.after)
            if worst > MOST_OTHERS:
                told.append(
                    f"The machine was busy: other programs took up to {worst:.0%} of a core, "
                    "which makes the same work cost more processor time."
                )
        if row.measure.key == "fps_given":
            differ = max(
                abs(after / before - 1) for before, after in zip(row.before, row.after, strict=True)
            )
            if differ > MOST_RATE_DIFFERENCE:
                told.append(
                    f"The frames given differ by up to {differ:.0%} between the two: compare the "
                    "application by the frame."
                )
        if row.measure.key == "engaged_share":
            differ = max(
                abs(after - before) for before, after in zip(row.before, row.after, strict=True)
            )
            if differ > MOST_ENGAGED_DIFFERENCE:
                told.append(
                    f"The arm was engaged in shares of the ticks that differ by up to "
                    f"{differ:.0%}: the sessions did not do the same work."
                )
        if row.measure.target is not None and len(row.ratios) < pairs:
            told.append(f"{row.measure.name}: {len(row.ratios)} of {pairs} pairs.")
    return told


_HEADINGS = ("what", "before", "after", "ratio: min / median / max", "target", "")


def cells(row: Row) -> tuple[str, ...]:
    """The texts of one row: medians of the sides, and the pairs' ratios."""
    scale, unit = row.measure.scale, row.measure.unit
    ratios = row.ratios
    return (
        row.measure.name,
        f"{scale * median(row.before):.3g} {unit}",
        f"{scale * median(row.after):.3g} {unit}",
        f"{min(ratios):.2f} / {median(ratios):.2f} / {max(ratios):.2f}" if ratios else "",
        "" if row.measure.target is None else f"≤ {row.measure.target:.2f}",
        row.verdict,
    )


def table(rows: Sequence[Row]) -> Table:
    shown = Table(box=None)
    for index, heading in enumerate(_HEADINGS):
        shown.add_column(heading, justify="right" if 0 < index < 5 else "left")
    for row in rows:
        shown.add_row(*cells(row))
    return shown


def markdown(rows: Sequence[Row]) -> str:
    """The table for a document; a missed target is bold."""
    lines = ["| " + " | ".join(_HEADINGS) + " |", "|---|--:|--:|--:|--:|---|"]
    for row in rows:
        *texts, verdict = cells(row)
        shown = "**missed**" if verdict == "missed" else verdict
        lines.append("| " + " | ".join([*texts, shown]) + " |")
    return "\n".join(lines) + "\n"
