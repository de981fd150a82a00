"""The stages of a frame's way from the camera to the screen, and what they take; pure.

Summaries reckon with them frame by frame, running sessions with means: what a stage is called,
which one is not ours, and which of the others is the slowest is said here alone.
"""

from __future__ import annotations

from collections.abc import Mapping

from tams_app.records import LatencyState
from tams_app.units import NS_PER_MS

NETWORK = "network"
# By the key in summary.json, what a stage is in words; in their order.
STAGES = {
    "camera": "camera",  # exposure and transfer; on the rig the rendering
    "to_encoder": "camera to encoder",
    "encoder": "encoder",
    "sender": "pacing",  # at the sender
    NETWORK: "network and repair",  # until the jitter buffer has handed out the last packet
    "decoder": "decoder",
}
DISPLAY = "display"  # from the decoded frame to its drawing; only a window knows it
_WORDS = {**STAGES, DISPLAY: "display"}
REMEDIES = {  # short: the line has 80 columns
    "camera": "use less exposure or fewer frames",
    "sender": "the uplink is slow",
    DISPLAY: "use fewer frames or a GPU",
}
_WEIGHT = 1 / 16  # of a new frame in a mean: about half a second at 30 frames a second


def stage_words(stage: str) -> str:
    """A stage in words; one that only the other side knows has none."""
    return _WORDS.get(stage, "another stage")


def slowest_stage(ms: Mapping[str, float | None]) -> str | None:
    """The stage outside the network that takes longest; None: none is known."""
    known = {stage: value for stage, value in ms.items() if value is not None and stage != NETWORK}
    return max(known, key=lambda stage: known[stage]) if known else None


class StageMeans:
    """What the stages take on one side of a running session, as means over the latest frames.

    `step` from any thread, each stage from one; `latency` from any.
    """

    def __init__(self) -> None:
        self._ms: dict[str, float] = {}

    def step(self, stage: str, begin_ns: int, end_ns: int) -> None:
        """A frame has passed a stage; where either time is 0, not known, nothing is learned."""
        if begin_ns <= 0 or end_ns <= 0:
            return
        ms = (end_ns - begin_ns) / NS_PER_MS
        before = self._ms.get(stage, ms)
        self._ms[stage] = before + (ms - before) * _WEIGHT

    @property
    def ms(self) -> dict[str, float]:
        """By stage that frames have passed, its mean [ms]."""
        return self._ms.copy()

    @property
    def latency(self) -> LatencyState | None:
        """All stages that frames have passed together; None before the first."""
        ms = self.ms
        slowest = slowest_stage(ms)
        if slowest is None:
            return None
        return LatencyState(round(sum(ms.values())), slowest, round(ms[slowest]))


def together(one: LatencyState | None, other: LatencyState | None) -> LatencyState | None:
    """The stages of both; None where those of either are not known."""
    if one is None or other is None:
        return None
    longer = max(one, other, key=lambda side: side.slowest_ms)
    return LatencyState(one.total_ms + other.total_ms, longer.slowest, longer.slowest_ms)
