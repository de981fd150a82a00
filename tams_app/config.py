"""The whole configuration as typed models; every error names file, key and reason.

Keys carry their unit. Hard limits of the Lite 6 are those of UFACTORY's user manual.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from tams_app.errors import ConfigError
from tams_app.records import Phase

CONFIG_DIRECTORY = Path(__file__).resolve().parent.parent / "config"
DEFAULT_CONFIG = CONFIG_DIRECTORY / "tams.yaml"

LITE6_MAX_TCP_SPEED_MM_S = 500.0
LITE6_MAX_ACCELERATION_MM_S2 = 50_000.0
LITE6_MAX_JOINT_SPEED_RAD_S = math.pi
LITE6_REACH_MM = 440.0
MAX_STOP_TIME_S = 0.1

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Port = Annotated[int, Field(ge=0, le=65535)]
Triple = tuple[Finite, Finite, Finite]
Six = tuple[Finite, Finite, Finite, Finite, Finite, Finite]


class Section(BaseModel):
    """A part of the configuration: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _yes_is_no_number(cls, data: Any) -> Any:
        for name, value in data.items() if isinstance(data, dict) else ():
            field = cls.model_fields.get(name)
            if isinstance(value, bool) and field is not None and field.annotation in (int, float):
                raise ValueError(f"{name} must be a number, not {str(value).lower()}")
        return data


def stop_time_s(speed: float, acceleration: float, jerk: float) -> float:
    """Time [s] from `speed` [m/s] to rest under `acceleration` [m/s²] and `jerk` [m/s³]."""
    if speed < acceleration**2 / jerk:
        return 2.0 * math.sqrt(speed / jerk)
    return speed / acceleration + acceleration / jerk


# --- the arm and the hand -----------------------------------------------------------------------


class GuardConfig(Section):
    """The helper process that stops the arm when the control loop falls silent."""

    heartbeat_timeout_ms: Annotated[float, Field(ge=20, le=1000)] = 100.0


class ArmConfig(Section):
    """The Lite 6 and how it is reached."""

    host: str = "127.0.0.1"
    control_port: Port = 502
    report_port: Port = 30001  # the normal report; the real-time one is two above
    servo: Literal["velocity", "pose"] = "velocity"
    velocity_deadman_s: Positive = 0.1  # the controller's own deadman: `duration`
    reply_timeout_s: Annotated[float, Field(gt=0, le=1)] = 0.05
    tcp_offset_mm_deg: Six = (0, 0, 82, 0, 0, 0)
    tcp_load_kg: NonNegative = 0.35
    tcp_load_centre_mm: Triple = (0, 0, 40)
    collision_sensitivity: Annotated[int, Field(ge=1, le=5)] = 3
    ready_joints_deg: Six = (0, 36.81, 86.74, 0, 49.93, 0)  # TCP (350, 0, 180) mm, gripper down
    pose_gain_per_s: Positive = 4.0  # outer P-loop of the velocity servo
    guard: GuardConfig = GuardConfig()


class ClutchConfig(Section):
    """Trigger hysteresis and the mode button."""

    engage_above: Fraction = 0.6
    release_below: Fraction = 0.4

    @model_validator(mode="after")
    def _hysteresis(self) -> Self:
        if self.release_below >= self.engage_above:
            raise ValueError("release_below must be smaller than engage_above")
        return self


class HandConfig(Section):
    """From the controller's poses to velocities."""

    rotation: tuple[Triple, Triple, Triple] = ((0, 0, -1), (-1, 0, 0), (0, 1, 0))
    translation_scale: Annotated[float, Field(gt=0, le=5)] = 1.0
    rotation_scale: Annotated[float, Field(gt=0, le=5)] = 1.0
    smoothing_s: Positive = 0.04
    clamp_above_m_s: Positive = 1.5
    reject_above_m_s: Positive = 4.0
    clamp_above_rad_s: Positive = 6.0
    reject_above_rad_s: Positive = 15.0
    max_rejects: Annotated[int, Field(ge=1)] = 6

    @model_validator(mode="after")
    def _proper_rotation(self) -> Self:
        matrix = np.array(self.rotation)
        if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6):
            raise ValueError("rotation must be orthonormal")
        if np.linalg.det(matrix) < 0:
            raise ValueError("rotation is mirrored (determinant -1); calibrate the frame again")
        if self.reject_above_m_s <= self.clamp_above_m_s:
            raise ValueError("reject_above_m_s must exceed clamp_above_m_s")
        if self.reject_above_rad_s <= self.clamp_above_rad_s:
            raise ValueError("reject_above_rad_s must exceed clamp_above_rad_s")
        return self


class ProfileConfig(Section):
    """Acceleration and jerk of one motion profile, linear and angular."""

    acceleration_m_s2: Positive
    jerk_m_s3: Positive
    acceleration_rad_s2: Positive
    jerk_rad_s3: Positive

    @model_validator(mode="after")
    def _hard_limit(self) -> Self:
        if self.acceleration_m_s2 * 1000 > LITE6_MAX_ACCELERATION_MM_S2:
            raise ValueError(
                f"acceleration_m_s2 exceeds the Lite 6's {LITE6_MAX_ACCELERATION_MM_S2 / 1000:g}"
            )
        return self


class MotionProfileConfig(ProfileConfig):
    """While engaged."""

    acceleration_m_s2: Positive = 1.5
    jerk_m_s3: Positive = 20.0
    acceleration_rad_s2: Positive = 4.0
    jerk_rad_s3: Positive = 60.0


class StopProfileConfig(ProfileConfig):
    """After a release: 250 mm/s to rest within 100 ms."""

    acceleration_m_s2: Positive = 5.0
    jerk_m_s3: Positive = 100.0
    acceleration_rad_s2: Positive = 12.0
    jerk_rad_s3: Positive = 250.0  # also from 0.5 rad/s while it still speeds up


class LimitsConfig(Section):
    """Speed, acceleration, jerk and space the arm never leaves."""

    max_speed_mm_s: Annotated[float, Field(gt=0, le=LITE6_MAX_TCP_SPEED_MM_S)] = 250.0
    max_rotation_rad_s: Annotated[float, Field(gt=0, le=LITE6_MAX_JOINT_SPEED_RAD_S)] = 0.5
    motion: MotionProfileConfig = MotionProfileConfig()
    stop: StopProfileConfig = StopProfileConfig()
    box_min_mm: Triple = (150, -330, 5)
    box_max_mm: Triple = (420, 330, 400)
    radius_min_mm: NonNegative = 180.0  # from the base axis
    radius_max_mm: Annotated[float, Field(gt=0, le=LITE6_REACH_MM)] = 425.0
    floor_mm: Finite = 5.0
    slow_down_mm: Positive = 30.0  # the outward speed shrinks to zero over this distance
    cone_deg: Annotated[float, Field(gt=0, le=90)] = 35.0  # about the ready orientation
    singularity_scale_from: Annotated[float, Field(gt=0, lt=1)] = 0.7
    leash_mm: Positive = 15.0  # following error at which the target waits for the arm
    leash_fault_mm: Positive = 60.0
    leash_rad: Positive = 0.15

    @model_validator(mode="after")
    def _sane(self) -> Self:
        if any(low >= high for low, high in zip(self.box_min_mm, self.box_max_mm, strict=True)):
            raise ValueError("box_min_mm must be below box_max_mm on every axis")
        if self.radius_min_mm >= self.radius_max_mm:
            raise ValueError("radius_min_mm must be smaller than radius_max_mm")
        for key in ProfileConfig.model_fields:
            if getattr(self.stop, key) < getattr(self.motion, key):
                raise ValueError(f"stop.{key} must not be below motion.{key}")
        linear = stop_time_s(
            self.max_speed_mm_s / 1000, self.stop.acceleration_m_s2, self.stop.jerk_m_s3
        )
        angular = stop_time_s(
            self.max_rotation_rad_s, self.stop.acceleration_rad_s2, self.stop.jerk_rad_s3
        )
        for name, needed in (("max_speed_mm_s", linear), ("max_rotation_rad_s", angular)):
            if needed > MAX_STOP_TIME_S + 1e-9:
                raise ValueError(
                    f"{name} needs {needed * 1000:.0f} ms to stop with the stop profile; "
                    f"at most {MAX_STOP_TIME_S * 1000:.0f} ms are allowed"
                )
        return self


class FreshnessConfig(Section):
    """How old an input may be before the arm holds or faults."""

    hold_pose_ms: Positive = 25.0  # an unchanged pose keeps its velocity this long
    pose_frozen_ms: Positive = 100.0
    buttons_ms: Positive = 100.0
    arm_state_ms: Positive = 100.0
    arm_reply_ms: Positive = 100.0
    video_slow_ms: Positive = 500.0
    video_hold_ms: Positive = 1000.0

    @model_validator(mode="after")
    def _order(self) -> Self:
        if self.video_slow_ms >= self.video_hold_ms:
            raise ValueError("video_slow_ms must be smaller than video_hold_ms")
        if self.hold_pose_ms >= self.pose_frozen_ms:
            raise ValueError("hold_pose_ms must be smaller than pose_frozen_ms")
        return self


class ControlConfig(Section):
    """The control loop."""

    rate_hz: Annotated[float, Field(ge=30, le=250)] = 120.0
    realtime_priority: Annotated[int, Field(ge=0, le=98)] = 50  # SCHED_FIFO; 0 asks for none


# --- policy -------------------------------------------------------------------------------------


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
    static_weights: dict[str, Fraction] = {"eih": 0.50, "gt": 0.25, "gs": 0.25}

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


# --- video and network --------------------------------------------------------------------------


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
    pli_min_interval_ms: Positive = 300.0

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


# --- rig, trial, recording ----------------------------------------------------------------------


class OperatorConfig(Section):
    """The scripted operator of the simulated rig."""

    reach_speed_m_s: Positive = 0.20
    fine_speed_m_s: Positive = 0.06
    arm_reach_m: Positive = 0.18  # hand travel from its rest point before it must re-clutch
    position_noise_mm: NonNegative = 0.15
    rotation_noise_deg: NonNegative = 0.05
    reaction_s: NonNegative = 0.25


class RigConfig(Section):
    """The simulated rig, started in processes of its own."""

    enabled: bool = True
    render_nice: Annotated[int, Field(ge=0, le=19)] = 10
    camera_noise_sigma: Annotated[float, Field(ge=0, le=20)] = 1.5  # grey levels of 255
    operator: OperatorConfig = OperatorConfig()


class TrialConfig(Section):
    """The rules of a trial (paper, section IV)."""

    limit_s: Positive = 120.0
    success_within_s: Positive = 90.0
    max_drops: Annotated[int, Field(ge=0)] = 2


class RecordingConfig(Section):
    """What a session leaves behind."""

    directory: str = "logs"
    record_reference: bool = False
    min_free_mb: NonNegative = 500.0


class Config(Section):
    """Everything a session is built from."""

    version: Literal[1]
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")] = "run"
    seed: Annotated[int, Field(ge=0)] = 0
    strategy: str = "tams"
    network: str = "s2"
    seconds: Positive | None = None
    headless: bool = False
    arm: ArmConfig = ArmConfig()
    clutch: ClutchConfig = ClutchConfig()
    hand: HandConfig = HandConfig()
    limits: LimitsConfig = LimitsConfig()
    freshness: FreshnessConfig = FreshnessConfig()
    control: ControlConfig = ControlConfig()
    policy: PolicyConfig
    video: VideoConfig = VideoConfig()
    networks: dict[str, Network]
    rig: RigConfig = RigConfig()
    trial: TrialConfig = TrialConfig()
    recording: RecordingConfig = RecordingConfig()

    @model_validator(mode="after")
    def _views_have_weights(self) -> Self:
        weighted = set(self.policy.weights.matrix[Phase.REACH])
        if weighted != set(self.video.views):
            raise ValueError(f"policy.weights name {sorted(weighted)}, video.views do not")
        if set(self.policy.allocation.static_weights) != set(self.video.views):
            raise ValueError("policy.allocation.static_weights must name each of video.views")
        return self


# --- reading ------------------------------------------------------------------------------------


def load_config(path: Path | None = None, overrides: dict[str, Any] | None = None) -> Config:
    """Read a YAML file, lay dotted-key `overrides` over it and check everything.

    `include:` at the top of a file lists files beside it whose keys it takes over and may replace.
    Raises ConfigError with file, key and reason.
    """
    path = path or DEFAULT_CONFIG
    content = _read_with_includes(path, ())
    overrides = overrides or {}
    for dotted, value in overrides.items():
        _override(content, dotted, value, path)
    try:
        return Config.model_validate(content)
    except ValidationError as error:
        key = _key(error)
        source = "command line" if key in overrides else str(path)
        raise ConfigError(f"{source}: {describe_validation_error(error)}") from error


def describe_validation_error(error: ValidationError) -> str:
    """One sentence for the first thing that is wrong: key and reason."""
    first = error.errors()[0]
    key = _key(error)
    reason = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        reason = "no such key"
    others = error.error_count() - 1
    more = f" (and {others} more)" if others else ""
    return f"{key}: {reason}{more}" if key else f"{reason}{more}"


def _key(error: ValidationError) -> str:
    return ".".join(str(part) for part in error.errors()[0]["loc"])


def _override(content: dict[str, Any], dotted: str, value: Any, path: Path) -> None:
    *parents, leaf = dotted.split(".")
    section = content
    for parent in parents:
        section = section.setdefault(parent, {})
        if not isinstance(section, dict):
            raise ConfigError(f"{path}: {parent}: must hold keys and values")
    section[leaf] = value


def _read_with_includes(path: Path, including: tuple[Path, ...]) -> dict[str, Any]:
    """The content of `path` over that of the files it includes; `including`: how we got here."""
    resolved = path.resolve()
    if resolved in including:
        raise ConfigError(f"{path}: include: the file includes itself")
    content = _read_yaml(path)
    includes = content.pop("include", [])
    if not isinstance(includes, list) or not all(isinstance(name, str) for name in includes):
        raise ConfigError(f"{path}: include: must be a list of file names")
    merged: dict[str, Any] = {}
    for name in includes:
        _lay_over(merged, _read_with_includes(path.parent / name, (*including, resolved)))
    _lay_over(merged, content)
    return merged


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        line = " ".join(str(error).split())
        raise ConfigError(f"{path}: is not valid YAML: {line}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: must hold keys and values")
    return content


def _lay_over(base: dict[str, Any], top: dict[str, Any]) -> None:
    for key, value in top.items():
        if isinstance(value, dict) and isinstance(base.get(key), dict):
            _lay_over(base[key], value)
        else:
            base[key] = value


def dump_config(config: Config) -> str:
    """The effective configuration as YAML that `load_config` reads back."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)
