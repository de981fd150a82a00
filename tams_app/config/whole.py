"""The rig, the trial, the recording, and the whole."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tams_app.config.devices import CameraConfig, ControllerConfig, ControllerType, MappingConfig
from tams_app.config.motion import (
    ArmConfig,
    ClutchConfig,
    ControlConfig,
    FreshnessConfig,
    HandConfig,
    LimitsConfig,
    check_rotation,
)
from tams_app.config.section import NonNegative, Positive, Section, Triple
from tams_app.config.streaming import Network, PolicyConfig, VideoConfig
from tams_app.records import Phase


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
    render_nice: Annotated[int, Field(ge=0, le=19)] = 10  # where no better one is permitted
    camera_noise_sigma: Annotated[float, Field(ge=0, le=20)] = 1.5  # grey levels of 255
    operator: OperatorConfig = OperatorConfig()
    # How the tracking frame truly stands to the arm, None: as hand.rotation says. Where they differ
    # the operator's hand and the arm go different ways, until `calibrate frame` has been run.
    hand_rotation: tuple[Triple, Triple, Triple] | None = None
    controller_type: ControllerType = "vive_focus3_controller"
    # Which component each part of the controller truly moves; what is not given, the usual one.
    wiring: MappingConfig = MappingConfig()
    # A session's log: its recorded hand moves the controller, open loop, in the operator's place.
    hand_trajectory: str | None = None

    @model_validator(mode="after")
    def _moves_no_real_arm(self) -> Self:
        if self.hand_trajectory is not None and not self.enabled:
            raise ValueError("hand_trajectory is for the simulated rig: no arm moves unattended")
        return self

    @model_validator(mode="after")
    def _turned_and_not_mirrored(self) -> Self:
        if self.hand_rotation is not None:
            check_rotation("hand_rotation", self.hand_rotation)
        return self


class TrialConfig(Section):
    """The rules of a trial (paper, section IV)."""

    limit_s: Positive = 120.0
    success_within_s: Positive = 90.0
    max_drops: Annotated[int, Field(ge=0)] = 2


class StudyConfig(Section):
    """What a study compares: every strategy on every network (paper, section IV)."""

    title: str = "TAMS study"  # of the plan and the report
    strategies: Annotated[tuple[str, ...], Field(min_length=1)] = ("equal", "static", "tams")
    networks: Annotated[tuple[str, ...], Field(min_length=1)] = ("s1", "s2", "s3")
    reference: str = "equal"  # what the others are compared with
    proposed: str = "tams"  # what the study is about
    repetitions: Annotated[int, Field(ge=1)] = 3
    practice_trials: Annotated[int, Field(ge=0)] = 0  # per participant, never analysed
    scene_marks: Annotated[int, Field(ge=1)] = 5  # start marks for the block on a real table

    @model_validator(mode="after")
    def _compares_what_it_runs(self) -> Self:
        for names in (self.strategies, self.networks):
            if len(set(names)) < len(names):
                raise ValueError(f"{', '.join(names)}: each may be named once only")
        for key in ("reference", "proposed"):
            if getattr(self, key) not in self.strategies:
                raise ValueError(f"{key} must be one of {', '.join(self.strategies)}")
        return self


class RecordingConfig(Section):
    """What a session leaves behind."""

    directory: str = "logs"
    record_reference: bool = False
    bitstream: bool = True  # the encoded frames themselves: nearly all of a log's size
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
    # the set of measured files beside this one, calibration/<name>/, that is laid over it
    calibration: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] | None = None
    calibrated_by: tuple[str, ...] = ()  # filled in when the configuration is read
    arm: ArmConfig = ArmConfig()
    clutch: ClutchConfig = ClutchConfig()
    hand: HandConfig = HandConfig()
    limits: LimitsConfig = LimitsConfig()
    freshness: FreshnessConfig = FreshnessConfig()
    control: ControlConfig = ControlConfig()
    controller: ControllerConfig = ControllerConfig()
    cameras: dict[str, CameraConfig] = Field(
        default_factory=dict
    )  # by view; the rig brings its own
    policy: PolicyConfig
    video: VideoConfig = VideoConfig()
    networks: dict[str, Network]
    rig: RigConfig = RigConfig()
    trial: TrialConfig = TrialConfig()
    study: StudyConfig = StudyConfig()
    recording: RecordingConfig = RecordingConfig()

    @model_validator(mode="after")
    def _views_have_weights(self) -> Self:
        weighted = set(self.policy.weights.matrix[Phase.REACH])
        if weighted != set(self.video.views):
            raise ValueError(f"policy.weights name {sorted(weighted)}, video.views do not")
        if set(self.policy.allocation.static_weights) != set(self.video.views):
            raise ValueError("policy.allocation.static_weights must name each of video.views")
        return self

    @model_validator(mode="after")
    def _views_have_cameras(self) -> Self:
        if not self.rig.enabled and set(self.cameras) != set(self.video.views):
            raise ValueError("cameras must name each of video.views, and nothing else")
        return self
