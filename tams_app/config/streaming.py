"""Sections of the bits' allocation, and of the video and networks that carry them."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tams_app.config.section import Fraction, NonNegative, Positive, Section, Word
from tams_app.records import Phase


class PhasesConfig(Section):
    """Thresholds and dwell times of Algorithm 1 (paper, section III-B)."""

    inference: Word = "motion"
    """What infers the phase: `motion` is Algorithm 1; `reference`, too, but to it a gripper that is
    closed in the first report has just closed: the phase is GRASP, not REACH."""
    v_eps_mm_s: NonNegative = 5.0
    """v_ε: at this smoothed speed of the TCP or less, the phase is held."""
    vz_min_mm_s: NonNegative = 15.0
    """v_z^min: a descent is faster than this."""
    align_dwell_s: NonNegative = 0.3
    """T_align: a descent with the gripper open lasts this long before it is Align."""
    pre_release_dwell_s: NonNegative = 0.3
    """T_pre: a descent with the gripper closed lasts this long before it is Pre-release."""
    smoothing_ms: NonNegative = 100.0
    """Time constant of the speeds' exponential moving average; 0: they are not smoothed."""


class WeightsConfig(Section):
    """The view weight matrix W, one row per phase, each summing to 1 (paper, Table I)."""

    matrix: dict[Phase, dict[str, Fraction]]
    """The share of each view in each phase; each row sums to 1."""

    @model_validator(mode="after")
    def _rows(self) -> Self:
        missing = [phase.value for phase in Phase if phase not in self.matrix]
        if missing:
            raise ValueError(f"matrix lacks the rows {', '.join(missing)}")
        views = set(self.matrix[Phase.REACH])
        for phase, row in self.matrix.items():
            if set(row) != views:
                raise ValueError(f"matrix.{phase.value} must name the views {sorted(views)}")
            if not math.isclose(sum(row.values()), 1.0, abs_tol=1e-9):
                raise ValueError(f"matrix.{phase.value} sums to {sum(row.values()):g}, not 1")
        return self


class AllocationConfig(Section):
    """The allocation rule (paper, section III-D)."""

    floor_kbps: NonNegative = 150.0
    """b_min: what each view gets at least, if the budget allows."""
    static_weights: dict[str, Fraction] = Field(
        default_factory=lambda: {"eih": 0.50, "gt": 0.25, "gs": 0.25}
    )
    """Shares of the views for strategy `static`; they sum to 1."""

    @model_validator(mode="after")
    def _sum(self) -> Self:
        if not math.isclose(sum(self.static_weights.values()), 1.0, abs_tol=1e-9):
            raise ValueError(f"static_weights sum to {sum(self.static_weights.values()):g}, not 1")
        return self


class BudgetConfig(Section):
    """Source of the uplink's capacity."""

    mode: Word = "feedback"
    """Where the capacity comes from: `oracle`, the emulated link itself; `sender`, receivers'
    reports; `feedback`, each packet's fate."""
    safety_factor: Annotated[float, Field(gt=0, le=1)] = 0.92
    """Share of the capacity that is given to the views."""
    max_kbps: Positive = 20_000.0
    """Capacity at most; that of network `none`."""
    delay_target_ms: Annotated[float, Field(ge=5, le=150)] = 40.0
    """`sender`: a packet that waits longer at the bottleneck has met congestion; `feedback`: the
    longest queue that it aims at, where delays vary."""


class PolicyConfig(Section):
    """The policy loop, and all that decides the bits."""

    rate_hz: Annotated[float, Field(ge=1, le=120)] = 20.0
    """Steps of the policy loop."""
    phases: PhasesConfig = PhasesConfig()
    weights: WeightsConfig
    allocation: AllocationConfig = AllocationConfig()
    budget: BudgetConfig = BudgetConfig()


class QualityConfig(Section):
    """Comparison (SSIM) of the frames shown with those captured, while a session runs.

    A process of idle priority (220 MB) that takes up to half a core where cores are idle, and
    hardly anything where they are not; how many frames it scores is reported. The application's
    threads pay .1 ms for each frame captured or shown. Where that is too much, switch it off: the
    SSIM keys of summary.json are null then.
    """

    enabled: bool = True
    """Whether frames are scored while the session runs."""


_LARGEST_PROTECTED_BYTES = 1465  # with 7 of parity, and 28 of IP and UDP: 1500


RepairMode = Literal["paper", "adaptive"]


class RepairConfig(Section):
    """Repair of lost packets (`video/core/repair.py` has the rule)."""

    mode: RepairMode = "adaptive"
    """`paper`: resending where it takes at most 200 ms, no parity. `adaptive`: resending of what
    comes within `video.latency_bound_ms`, parity where not all does."""
    rtx: Literal["auto", "on", "off"] = "auto"
    """Whether lost packets are sent again; `auto`: as `mode` says."""
    parity: Literal["auto", "on", "off"] = "auto"
    """In mode `adaptive`: whether frames are sent with parity packets. `auto`: where resending
    comes too late, the views that gain by it; `on`: every view, at least one packet a frame."""
    pli: bool = True
    """Whether a keyframe is asked for where a packet stays lost."""


class VideoConfig(Section):
    """The same settings for all views and strategies."""

    views: tuple[str, ...] = ("eih", "gt", "gs")
    """Names of the views, each once."""
    width: Annotated[int, Field(ge=160, le=1920, multiple_of=8)] = 640
    """Width of a frame in pixels; rows have no padding."""
    height: Annotated[int, Field(ge=120, le=1080, multiple_of=2)] = 480
    """Height of a frame in pixels."""
    fps: Annotated[int, Field(ge=5, le=60)] = 30
    """Frames per second that each camera is asked for."""
    preset: Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium"] = "superfast"
    """x264's speed preset."""
    keyframe_interval: Annotated[int, Field(ge=1)] = 600
    """Frames between two keyframes at most."""
    mtu_bytes: Annotated[int, Field(ge=256, le=1472)] = 1200
    """Payload of an RTP packet at most."""
    repair: RepairConfig = RepairConfig()
    latency_bound_ms: Annotated[float, Field(ge=20, le=2000)] = 200.0
    """In repair mode `adaptive`: no frame waits for a resend until later than this after it was
    sent."""
    pli_min_interval_ms: Positive = 300.0
    """Time between two requests for a keyframe at least."""
    quality: QualityConfig = QualityConfig()

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        if len(set(self.views)) != len(self.views) or not self.views:
            raise ValueError(f"views must be different names, at least one: {list(self.views)}")
        if self.repair.mode == "adaptive" and self.mtu_bytes > _LARGEST_PROTECTED_BYTES:
            raise ValueError(
                f"mtu_bytes must be at most {_LARGEST_PROTECTED_BYTES} with repair.mode adaptive: "
                "a parity packet is 7 bytes longer than those it protects"
            )
        return self


class Network(Section):
    """One uplink condition; without a rate there is no bottleneck."""

    latency_ms: NonNegative = 0.0
    """One-way delay behind the bottleneck."""
    jitter_ms: NonNegative = 0.0
    """The delay is uniform in latency_ms ± this."""
    loss: Fraction = 0.0
    """Share of packets that are lost."""
    loss_burst: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 1.0
    """Mean length of a burst of losses; 1 is independent loss."""
    rate_kbps: Annotated[float, Field(ge=1, le=1e9)] | None = None
    """Rate of the bottleneck; null: none."""
    trace: str | None = None
    """File of a capacity trace; its rates take the place of rate_kbps."""
    queue_ms: Positive = 150.0
    """Length of the bottleneck's queue."""
    queue_min_bytes: Annotated[int, Field(ge=1500)] = 30_000
    """Size of that queue at least."""

    @model_validator(mode="after")
    def _possible_bursts(self) -> Self:
        if self.loss < 1 and 1 < self.loss_burst < self.loss / (1 - self.loss):
            raise ValueError(f"loss {self.loss:g} cannot come in bursts of {self.loss_burst:g}")
        return self


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
    """Without a usable sample for so long the arm holds."""
    max_age_ms: Annotated[float, Field(ge=20, le=3000)] | None = None
    """A sample that may be older does not move the arm; null: twice latency and jitter, and 200.

    Or, if that is more, the round trip as it is measured, and 200, together at most 650.
    """
    fault_after_ms: Annotated[float, Field(ge=100, le=3000)] = 3000.0
    """A gap without a usable sample is a hold for so long, then a fault; above lost_after_ms."""

    @model_validator(mode="after")
    def _order(self) -> Self:
        self.require_order(("lost_after_ms", "fault_after_ms"))
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
