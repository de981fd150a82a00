"""One record of each kind that ROS 2 is told of."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.config import load_config
from tams_app.recording import Header
from tams_app.recording.rates import Rates, ViewRates
from tams_app.recording.topics import OutcomeGiven
from tams_app.records import (
    EncodedFrame,
    Note,
    Outcome,
    Phase,
    PhaseChange,
    Pose,
    SceneTruth,
    StopRecord,
)
from tams_app.rotation import Rotation
from tests.synthetic_session import START_NS, VIEWS, header, tick

T_NS = START_NS + 1_234_567_891


def full_header(**overrides: Any) -> Header:
    """With a whole configuration, as a session's."""
    return header(config=load_config(None, overrides).model_dump(mode="json"))


def rates() -> Rates:
    views = tuple(
        ViewRates(view, 1000.0 + number, 990.5, 0.01, 30.0, 29.0, 61.0, 0.9, None, 0.8, None)
        for number, view in enumerate(VIEWS)
    )
    return Rates(T_NS, 3003.0, 2971.5, 5520.0, 6000.0, 5900.0, 12.5, None, views)


def frame(view: str = "eih", data: bytes = b"\0\0\0\1\x65abc") -> EncodedFrame:
    return EncodedFrame(view, 7, T_NS, T_NS + 4_000_000, True, data, T_NS + 1_000_000, 21_000)


def truth() -> SceneTruth:
    block = Pose(np.array([0.3, 0.0, 0.01]), Rotation.identity())
    container = Pose(np.array([0.3, 0.1, 0.0]), Rotation.from_quat([0, 0, 1, 0]))
    return SceneTruth(T_NS, block, container, block, 0.0, 0.016)


def one_of_each() -> list[Any]:
    return [
        tick(5),
        truth(),
        PhaseChange(T_NS, Phase.ALIGN, "descending"),
        rates(),
        *map(frame, VIEWS),
        Note(T_NS, "warning", "a camera is slow"),
        StopRecord("stale video", T_NS, T_NS + 50_000_000),
        OutcomeGiven(T_NS, Outcome(True, True, 41.2, 0, "placed")),
    ]
