"""A session as one HTML page that needs no other file: what happened, why, how it looked."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from tams_app import __version__
from tams_app.outputs import write_file
from tams_app.policy.weights import WeightMatrix
from tams_app.recording import SessionLog
from tams_app.recording.pictures import ShownPicture
from tams_app.report.pages import page_environment
from tams_app.report.timeline import Stretch, phase_stretches, stops_of, timeline_figure
from tams_app.teleop.advice import what_to_do
from tams_app.teleop.hands import words_of
from tams_app.units import NS_PER_MS, NS_PER_S

_TEMPLATE_NAME = "session.html.j2"
_STILL_WITHIN_S = 1.0  # of the phase's beginning


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop as people read it; `rest_ms` is None if the session ended before the arm rested."""

    number: int
    t_s: float
    reason: str
    advice: str
    rest_ms: float | None


@dataclass(frozen=True, slots=True)
class PhaseStills:
    """What the operator saw when a phase began: a picture of each view that there is one of."""

    phase: Stretch
    primary: str
    pictures: Mapping[str, str]  # the source of an image, by view


def write_page(
    log: SessionLog, summary: Mapping[str, Any], pictures: Iterable[ShownPicture], path: Path
) -> None:
    """Write the page of the session whose folder `path` is in; LogError if it cannot be written.

    `pictures`: those that were shown, with times by the log's wall clock.
    """
    page = session_page(log, summary, stills_of(log, pictures), path.parent.name)
    write_file(path, page)


def session_page(
    log: SessionLog, summary: Mapping[str, Any], stills: list[PhaseStills], title: str
) -> str:
    """The page; `title`: the session's folder."""
    environment = page_environment(Path(__file__).parent)
    environment.filters["number"] = _number
    return environment.get_template(_TEMPLATE_NAME).render(
        title=title,
        version=__version__,
        header=log.header,
        summary=summary,
        notes=[(_s(log, note.t_ns), note.level, note.text) for note in log.notes],
        stops=stop_rows(log),
        phases=phase_stretches(log),
        stills=stills,
        timeline=Markup(_svg(timeline_figure(log))),
    )


def stop_rows(log: SessionLog) -> list[Stop]:
    """Each stop with what to do about it, numbered as in the figure."""
    hand = words_of(log.facts)
    return [
        Stop(
            number,
            t_s,
            stop.reason,
            what_to_do(stop.reason, stop.reason, hand),
            None if stop.stopped_ns is None else (stop.stopped_ns - stop.visible_ns) / NS_PER_MS,
        )
        for number, (t_s, stop) in enumerate(stops_of(log), start=1)
    ]


def stills_of(log: SessionLog, pictures: Iterable[ShownPicture]) -> list[PhaseStills]:
    """For each phase the first picture of each view that was shown in its first second."""
    weights = WeightMatrix(log.header.weights) if log.header.weights else None
    phases = phase_stretches(log)
    found: list[dict[str, ShownPicture]] = [{} for _ in phases]
    for picture in pictures:
        t_s = _s(log, picture.shown_ns - log.header.wall_offset_ns)
        for phase, of_phase in zip(phases, found, strict=True):
            until_s = min(phase.start_s + _STILL_WITHIN_S, phase.end_s)
            if phase.start_s <= t_s < until_s:
                of_phase.setdefault(picture.view, picture)
    changes = [change.phase for change in log.phases]
    return [
        PhaseStills(
            phase,
            "" if weights is None else weights.primary_view(change),
            {view: _source(of_phase[view]) for view in log.header.views if view in of_phase},
        )
        for phase, change, of_phase in zip(phases, changes, found, strict=True)
    ]


def _source(picture: ShownPicture) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(picture.data).decode('ascii')}"


def _svg(figure: Figure) -> str:
    """As an element of a page: sharp at any size, with words that can be searched."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _s(log: SessionLog, t_ns: int) -> float:
    return (t_ns - log.header.started_ns) / NS_PER_S


def _number(value: float | None, form: str = "%.0f") -> str:
    return "–" if value is None else form % value
