"""A session as one HTML page that needs no other file: what happened, why, how it looked."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tams_app import __version__
from tams_app.outputs import write_file
from tams_app.recording import SessionLog
from tams_app.recording.reader import ShownPicture
from tams_app.report.figures import phase_stretches, stops_of, timeline_figure
from tams_app.report.pages import number, page_environment
from tams_app.report.plots import NamedStretch, to_svg
from tams_app.summary.tables import LogTables, primary_at
from tams_app.teleop.hands import words_of
from tams_app.teleop.reasons import what_to_do
from tams_app.video.core.stages import STAGES, slowest_stage, stage_words

_LEAST_RANGE = 8  # of a picture's grey levels; an encoder's first frames may show nothing at all


@dataclass(frozen=True, slots=True)
class StillPicture:
    """A picture of a view, `t_s` after the session's start; `source`: of an image in a page."""

    view: str
    t_s: float
    source: str


@dataclass(frozen=True, slots=True)
class PhaseStills:
    """What the operator saw as a phase began, and the views that the log has no picture of."""

    phase: NamedStretch
    primary: str
    pictures: tuple[StillPicture, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StagesTable:
    """A row for each view, a cell for each stage and all but the network.

    `slowest`: the longest stage of all, that of `view`.
    """

    names: list[str]
    rows: list[tuple[str, list[str]]]
    view: str
    slowest: str


def write_page(
    tables: LogTables, summary: Mapping[str, Any], pictures: Iterable[ShownPicture], path: Path
) -> None:
    """Write the page of the session whose folder `path` is in; LogError if it cannot be written.

    `pictures`: those that were shown, with times by the log's wall clock.
    """
    log = tables.log
    hand, stills = words_of(log.facts), stills_of(log, pictures)
    template = page_environment().get_template("session.html.j2")
    page = template.render(
        title=path.parent.name,
        version=__version__,
        header=log.header,
        summary=summary,
        notes=[(log.since_start_s(note.t_ns), note.level, note.text) for note in log.notes],
        # numbered as in the figure
        stops=[
            (t_s, stop, what_to_do(stop.reason, stop.reason, hand)) for t_s, stop in stops_of(log)
        ],
        stills=stills,
        has_pictures=any(still.pictures for still in stills),
        stages=stages_table(summary),
        timeline=to_svg(timeline_figure(tables)),
    )
    write_file(path, page)


def stages_table(summary: Mapping[str, Any]) -> StagesTable | None:
    """Where each view's latency comes from; None where no stage is known."""
    slowest_ms: dict[tuple[str, str], float] = {}
    rows = []
    for view, entry in summary["views"].items():
        stages = entry["latency_stages_ms"]
        p95_ms = {stage: stages[stage]["p95"] for stage in stages}
        if (slowest := slowest_stage(p95_ms)) is None:
            continue
        slowest_ms[view, slowest] = p95_ms[slowest]
        columns = (*stages.values(), entry["own_latency_ms"])
        rows.append((view, [f"{number(one['p50'])} / {number(one['p95'])}" for one in columns]))
    if not rows:
        return None
    view, stage = max(slowest_ms, key=slowest_ms.__getitem__)
    names = [*STAGES.values(), "without network"]
    return StagesTable(names, rows, view, stage_words(stage))


def stills_of(log: SessionLog, pictures: Iterable[ShownPicture]) -> list[PhaseStills]:
    """For each phase the first picture of each view that was shown in it and is not blank."""
    phases = phase_stretches(log)
    found: list[dict[str, StillPicture]] = [{} for _ in phases]
    for picture in pictures:
        t_s = log.since_start_s(picture.shown_ns - log.header.wall_offset_ns)
        for phase, of_phase in zip(phases, found, strict=True):
            is_new = phase.start_s <= t_s < phase.end_s and picture.view not in of_phase
            if is_new and not _is_blank(picture):
                coded = base64.b64encode(picture.data).decode("ascii")
                source = f"data:image/jpeg;base64,{coded}"
                of_phase[picture.view] = StillPicture(picture.view, t_s, source)
    began_ns = np.array([change.t_ns for change in log.phases], dtype=np.int64)
    names = (*log.header.views, "")  # the last one: none
    return [
        PhaseStills(
            phase,
            names[primary],
            tuple(of_phase[view] for view in log.header.views if view in of_phase),
            tuple(view for view in log.header.views if view not in of_phase),
        )
        for phase, primary, of_phase in zip(phases, primary_at(log, began_ns), found, strict=True)
    ]


def _is_blank(picture: ShownPicture) -> bool:
    pixels = np.frombuffer(picture.data, np.uint8)
    image = cv2.imdecode(pixels, cv2.IMREAD_REDUCED_GRAYSCALE_8) if len(pixels) else None
    return image is None or int(np.ptp(image)) < _LEAST_RANGE
