"""The link between the robot's computer and the operator's."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from tams_app.config.section import Section

_SPARE_MS = 200.0  # a message waits behind video at the bottleneck, and for the next sample
_LARGEST_MEASURED_MS = 650.0  # a round trip of 400 ms, jitter of 25 ms each way, and what it waits
_SILENCE_MS = 1000.0  # as old as `freshness.video_hold_ms`: then the arm holds for the video too


class LinkConfig(Section):
    """The network between `robot` and `operate`, as `doctor --link` measures it."""

    latency_ms: Annotated[float, Field(ge=0, le=1000)] = 20.0
    """One-way latency between the two computers."""
    jitter_ms: Annotated[float, Field(ge=0, le=400)] = 5.0
    """What is added to it at most, 95 times of 100."""
    bridge_ms: Annotated[float, Field(gt=0, le=50)] = 50.0
    """Takes the place of freshness.hold_pose_ms: so short a gap in the samples is bridged."""
    lost_after_ms: Annotated[float, Field(ge=60, le=1000)] = 100.0
    """Without a usable sample for so long the arm stops."""
    max_age_ms: Annotated[float, Field(ge=20, le=3000)] | None = None
    """A sample that may be older does not move the arm; null: twice latency and jitter, and 200.

    Or, if that is more, the round trip as it is measured, and 200, together at most 650.
    """
    fault_after_ms: Annotated[float, Field(ge=100, le=3000)] = 3000.0
    """A gap without a usable sample is a hold for so long, then a fault; above lost_after_ms."""

    @model_validator(mode="after")
    def _order(self) -> Self:
        if self.lost_after_ms >= self.fault_after_ms:
            raise ValueError("lost_after_ms must be smaller than fault_after_ms")
        return self

    def longest_age_ms(self, round_trip_ms: float | None = None) -> float:
        """`max_age_ms`, or what it is by default where a round trip takes so long at least.

        Args:
            round_trip_ms: as measured [ms]; None: not yet.
        """
        if self.max_age_ms is not None:
            return self.max_age_ms
        configured_ms = 2.0 * (self.latency_ms + self.jitter_ms) + _SPARE_MS
        measured_ms = min((round_trip_ms or 0.0) + _SPARE_MS, _LARGEST_MEASURED_MS)
        return max(configured_ms, measured_ms)

    @property
    def longest_silence_ms(self) -> float:
        """Age of the newest echo at which a sample moves nothing, however young it is itself [ms].

        Its sender has received nothing of the robot's side since.
        """
        return max(_SILENCE_MS, self.longest_age_ms())

    @property
    def stopped_after_ms(self) -> float:
        """Silence of the robot's side after which its arm is known to be stopped [ms].

        The last echo counts for `longest_silence_ms`, and the last sample until it is a gap.
        """
        return self.longest_silence_ms + self.lost_after_ms
