"""What decides the bits, and the video and network that carry them."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tams_app.config.section import Fraction, NonNegative, Port, Positive, Section
from tams_app.records import Phase


class PhasesConfig(Section):
    """Thresholds and dwell times of Algorithm 1 (paper, section III-B)."""

    v_eps_mm_s: NonNegative = 5.0
    vz_min_mm_s: NonNegative = 15.0
    align_dwell_s: NonNegative = 0.3
    pre_release_dwell_s: NonNegative = 0.3
    smoothing_ms: Positive = 100.0


class WeightsConfig(Section):
    """The view weight matrix W, one row per phase, each summing to 1 (paper, Table I)."""

    matrix: dict[Phase, dict[str, Fraction]]

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
    source_drop_below_kbps: NonNegative = 80.0
    static_weights: dict[str, Fraction] = Field(
        default_factory=lambda: {"eih": 0.50, "gt": 0.25, "gs": 0.25}
    )

    @model_validator(mode="after")
    def _sum(self) -> Self:
        if not math.isclose(sum(self.static_weights.values()), 1.0, abs_tol=1e-9):
            raise ValueError(f"static_weights sum to {sum(self.static_weights.values()):g}, not 1")
        return self


class BudgetConfig(Section):
    """Where the uplink capacity comes from."""

    mode: Literal["oracle", "sender"] = "oracle"
    safety_factor: Annotated[float, Field(gt=0, le=1)] = 0.92
    max_kbps: Positive = 20_000.0  # the capacity of network `none`
    start_kbps: Positive = 3_000.0  # sender: before the first statistics
    window_ms: Positive = 1000.0  # sender: sliding window
    trace_window_ms: Positive = 100.0  # oracle on a trace: mean of its last 100 ms


class PolicyConfig(Section):
    """The policy loop, and all that decides the bits."""

    rate_hz: Annotated[float, Field(ge=1, le=120)] = 20.0
    phases: PhasesConfig = PhasesConfig()
    weights: WeightsConfig
    allocation: AllocationConfig = AllocationConfig()
    budget: BudgetConfig = BudgetConfig()


class QualityConfig(Section):
    """Whether a session compares the frames shown with those captured while it runs (SSIM).

    A process of idle priority (220 MB) that takes up to half a core where cores are idle, and
    hardly anything where they are not; how many frames it scores is reported. The application's
    threads pay .1 ms for each frame captured or shown. Where that is too much, switch it off: the
    SSIM keys of summary.json are null then.
    """

    enabled: bool = True


class RepairConfig(Section):
    """How lost packets are repaired, the same for all views (`video/repair.py` has the rule)."""

    rtx: Literal["auto", "on", "off"] = "auto"  # auto: where a resend is in time, within 200 ms
    pli: bool = True  # ask for a keyframe where a packet stays lost


class VideoConfig(Section):
    """The same settings for all views and strategies."""

    views: tuple[str, ...] = ("eih", "gt", "gs")
    width: Annotated[int, Field(ge=160, le=1920, multiple_of=4)] = 640  # rows without padding
    height: Annotated[int, Field(ge=120, le=1080, multiple_of=2)] = 480
    fps: Annotated[int, Field(ge=5, le=60)] = 30
    preset: Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium"] = "superfast"
    vbv_ms: Positive = 33.0
    keyframe_interval: Annotated[int, Field(ge=1)] = 600
    mtu_bytes: Annotated[int, Field(ge=256, le=1472)] = 1200
    decoder: str = "avdec_h264"  # or auto, or any GStreamer H.264 decoder element
    bind_host: str = "127.0.0.1"
    first_port: Port = 0  # 0: any free ports; else three per view from here on
    repair: RepairConfig = RepairConfig()
    pli_min_interval_ms: Positive = 300.0
    quality: QualityConfig = QualityConfig()

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        if len(set(self.views)) != len(self.views) or not self.views:
            raise ValueError(f"views must be different names, at least one: {list(self.views)}")
        last = self.first_port + 3 * len(self.views) - 1
        if self.first_port and last > 65535:
            raise ValueError(f"first_port leaves no room for {3 * len(self.views)} ports")
        return self


class Network(Section):
    """One uplink condition; rate_kbps None means no bottleneck, a trace replaces the rate."""

    latency_ms: NonNegative = 0.0
    jitter_ms: NonNegative = 0.0
    loss: Fraction = 0.0
    loss_burst: Annotated[float, Field(ge=1)] = 1.0  # mean burst length; 1 is independent loss
    rate_kbps: Annotated[float, Field(ge=1, le=1e9)] | None = None
    trace: str | None = None  # file; its rates take the place of rate_kbps
    queue_ms: Positive = 150.0
    queue_min_bytes: Annotated[int, Field(ge=1500)] = 30_000

    @model_validator(mode="after")
    def _possible_bursts(self) -> Self:
        if self.loss < 1 and 1 < self.loss_burst < self.loss / (1 - self.loss):
            raise ValueError(f"loss {self.loss:g} cannot come in bursts of {self.loss_burst:g}")
        return self
