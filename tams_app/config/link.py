"""The link between the robot's computer and the operator's."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tams_app.config.section import Section

_SPARE_MS = 200.0  # a state message waits behind video at the bottleneck, and for the next sample


class LinkConfig(Section):
    """The network between `robot` and `operate`, as `doctor --link` measures it."""

    latency_ms: Annotated[float, Field(ge=0, le=1000)] = 20.0
    """One-way latency between the two computers."""
    jitter_ms: Annotated[float, Field(ge=0, le=400)] = 5.0
    """What is added to it at most, 95 times of 100."""
    bridge_ms: Annotated[float, Field(gt=0, le=50)] = 50.0
    """Takes the place of freshness.hold_pose_ms: so short a gap in the samples is bridged."""
    lost_after_ms: Annotated[float, Field(ge=60, le=1000)] = 100.0
    """Without a usable sample for so long the link is lost, and the arm stops."""
    max_age_ms: Annotated[float, Field(ge=20, le=3000)] | None = None
    """A sample that may be older does not move the arm; null: twice latency and jitter, and 200."""

    @property
    def longest_age_ms(self) -> float:
        """`max_age_ms`, or what it is by default."""
        if self.max_age_ms is not None:
            return self.max_age_ms
        return 2.0 * (self.latency_ms + self.jitter_ms) + _SPARE_MS

    @property
    def stopped_after_ms(self) -> float:
        """Silence of the robot's side after which its arm is known to be stopped.

        The last echo counts for `longest_age_ms`, then the link is lost.
        """
        return self.longest_age_ms + self.lost_after_ms
