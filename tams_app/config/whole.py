"""The rig, the trial, the recording, and the whole."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from tams_app.config.devices import (
    CameraConfig,
    ControllerConfig,
    ControllerType,
    HeadsetConfig,
    MappingConfig,
)
from tams_app.config.motion import (
    ArmConfig,
    ControlConfig,
    FreshnessConfig,
    HandConfig,
    LimitsConfig,
    check_rotation,
)
from tams_app.config.section import NonNegative, Positive, Section, Triple, Word
from tams_app.config.streaming import LinkConfig, Network, PolicyConfig, RepairMode, VideoConfig
from tams_app.errors import not_one_of
from tams_app.records import Phase

OperatorKind = Literal["seeing", "scripted"]


def _before_there_was_one_default(word: object) -> object:
    """`auto` was the default: seeing, where the computer was fast enough."""
    return "seeing" if word == "auto" else word


class OperatorConfig(Section):
    """The simulated rig's operator."""

    kind: Annotated[OperatorKind, BeforeValidator(_before_there_was_one_default)] = "seeing"
    """Who works in a live session: `seeing`, from the images alone; `scripted`, who knows where
    things are. Studies: always seeing."""
    looks_at: Literal["shown", "received"] = "shown"
    """What the seeing operator looks at where a view is predicted: what is `shown` of a frame, or
    the frame as it was `received`."""
    reach_speed_m_s: Positive = 0.20
    """Scripted: speed of the hand on long ways."""
    fine_speed_m_s: Positive = 0.06
    """Scripted: speed of the hand near block and container."""
    arm_reach_m: Positive = 0.18
    """Travel of the hand from its rest point before it has to re-clutch."""
    position_noise_mm: NonNegative = 0.15
    """Standard deviation of the tracked position."""
    rotation_noise_deg: NonNegative = 0.05
    """Standard deviation of the tracked rotation."""
    reaction_s: NonNegative = 0.25
    """Scripted: reaction time."""


class RigConfig(Section):
    """The simulated rig, started in processes of its own."""

    enabled: bool = True
    """Whether the simulated rig takes the place of arm, controller and cameras."""
    operator: OperatorConfig = OperatorConfig()
    hand_rotation: tuple[Triple, Triple, Triple] | None = None
    """How the tracking frame truly stands to the arm; null: as hand.rotation says."""
    controller_type: ControllerType = "vive_focus3_controller"
    """Type of the simulated controller."""
    wiring: MappingConfig = MappingConfig()
    """Which component each part of the controller truly moves; what is not given, the usual one."""
    hand_trajectory: str | None = None
    """A session's log whose recorded hand moves the controller instead of the operator."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.hand_trajectory is not None and not self.enabled:
            raise ValueError("hand_trajectory is for the simulated rig: no arm moves unattended")
        if self.hand_rotation is not None:
            check_rotation("hand_rotation", self.hand_rotation)
        return self


class ViewConfig(Section):
    """What the operator is shown of a late frame."""

    predict: Literal["off", "eih", "all"] = "off"
    """`eih`: the frames of a camera on the arm, whose pose on it is known, are drawn as they would
    look from where the arm is now; `all`: besides, those of the others get an outline of where the
    arm is now; `off`: all frames as received."""


class TrialConfig(Section):
    """The rules of a trial (paper, section IV)."""

    limit_s: Positive = 120.0
    """Time for a trial from the first engagement."""


class StudyConfig(Section):
    """Conditions of a study: every strategy on every network (paper, section IV)."""

    title: str = "TAMS study"
    """Title of the plan and the report."""
    strategies: Annotated[tuple[str, ...], Field(min_length=1)] = ("equal", "static", "tams")
    """Strategies that are compared, each once."""
    networks: Annotated[tuple[str, ...], Field(min_length=1)] = ("s1", "s2", "s3")
    """Networks on which they are compared, each once."""
    budget: Word = "oracle"
    """Takes the place of policy.budget.mode; `oracle` as in the paper, whose capacity is known."""
    repair: RepairMode = "paper"
    """Takes the place of video.repair.mode."""
    reference: str = "equal"
    """The strategy that the others are compared with."""
    proposed: str = "tams"
    """The strategy that the study is about."""
    repetitions: Annotated[int, Field(ge=1)] = 3
    """Trials of each strategy on each network, for each participant."""
    practice_trials: Annotated[int, Field(ge=0)] = 0
    """Trials of each participant before the others, never analysed."""
    scene_marks: Annotated[int, Field(ge=1)] = 5
    """Start marks for the block on a real table."""

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
    """Files and channels of a session's record."""

    directory: str = "logs"
    """Where session folders are made; relative to the working directory."""
    record_reference: bool = False
    """Whether lossless captures are kept, too."""
    bitstream: bool = True
    """Whether the encoded frames themselves are kept: most of a log's size."""
    viewers: bool = True
    """Whether the log also has channels for Foxglove that are derived from its records; with
    `foxglove` it always has."""
    pictures_per_s: Annotated[float, Field(ge=0, le=60)] = 2.0
    """With `viewers`: frames of each view as they were shown that are kept a second, as JPEG."""
    foxglove: str = ""
    """HOST:PORT where Foxglove may connect while a session runs; empty: nowhere."""
    foxglove_origins: tuple[str, ...] = ("https://app.foxglove.dev", "file://")
    """Web pages that may connect there, by origin; programs that are no browser may always."""
    ros2: Annotated[int, Field(ge=0, le=232)] | None = None
    """Domain of ROS 2 in which a session is published while it runs; null: none."""
    min_free_mb: NonNegative = 500.0
    """Free disk space that a session wants at its start; it ends below a tenth of that."""
    episodes: bool = False
    """Whether a session is divided into episodes, which the operator begins, keeps and discards."""
    episode_count: Annotated[int, Field(ge=0)] = 0
    """With `episodes`: the session ends when so many are kept; 0: any number."""
    episode_limit_s: Positive = 120.0
    """With `episodes`: the longest that one may take; it then ends, and is kept."""
    countdown_s: Annotated[float, Field(ge=0, le=60)] = 3.0
    """With `episodes`: time from the request to the begin of an episode."""


class Ros2Config(Section):
    """Words that a session has in ROS 2."""

    dialect: Literal["tams", "reference"] = "tams"
    """`reference`: besides, phase and targets by the topics and words of the authors' nodes."""


_METRICS = (
    "there are no figures for Prometheus any more: Foxglove shows them while a session runs "
    "(--foxglove), summary.json has them afterwards; leave it out"
)
_PADS = (
    "TAMS does not read gamepads and 3D mice any more: use the keyboard, or install a driver "
    "(entry point `tams.controllers`)"
)
_CAMERAS = (
    "`calibrate cameras` measures which camera is which, latency, lens and mount only: focus in a "
    "session's window, set cameras.VIEW.exposure_us, and see frame rates in summary.json"
)
_FPS = "cameras give what the machine can, of video.fps (--fps) at most; leave it out"
_STROKES = "the wizard asks for strokes, and hand.translation_scale is yours to set; leave it out"
_MARKS = "mark each LOG with `replay LOG --mark`, and give the marked ones with --from"
_CALIBRATED = "the figure is beside the file that it writes; leave it out"
_FIGURES = "its figures are in the file that it writes; leave it out"
_CONSTANTS: dict[str, tuple[object, str]] = {  # the value, and the module that has it
    "policy.allocation.source_drop_below_kbps": (80.0, "tams_app.policy.strategy"),
    "policy.budget.start_kbps": (3000.0, "tams_app.policy.budget.sender"),
    "policy.budget.window_ms": (1000.0, "tams_app.policy.budget.sender"),
    "policy.budget.trace_window_ms": (100.0, "tams_app.policy.budget"),
    "arm.pose_gain_per_s": (4.0, "tams_app.teleop.drive"),
    "clutch.engage_above": (0.6, "tams_app.presses"),
    "clutch.release_below": (0.4, "tams_app.presses"),
    "controller.desk.ramp_s": (0.25, "hw.desk.keyboard"),
    "hand.smoothing_s": (0.04, "tams_app.teleop.motion"),
    "hand.clamp_above_m_s": (1.5, "tams_app.teleop.motion"),
    "hand.reject_above_m_s": (4.0, "tams_app.teleop.motion"),
    "hand.clamp_above_rad_s": (6.0, "tams_app.teleop.motion"),
    "hand.reject_above_rad_s": (15.0, "tams_app.teleop.motion"),
    "hand.max_rejects": (6, "tams_app.teleop.motion"),
    "hand.max_drift_mm": (25.0, "tams_app.teleop.motion"),
    "hand.max_drift_deg": (4.0, "tams_app.teleop.motion"),
    "limits.singularity_scale_from": (0.7, "tams_app.teleop.limits"),
    "rig.render_nice": (10, "hw.sim.world.renderer"),
    "rig.camera_noise_sigma": (1.5, "hw.sim.world.scene_renderer"),
    "trial.success_within_s": (90.0, "tams_app.task.judge"),
    "trial.max_drops": (2, "tams_app.task.judge"),
    "video.vbv_ms": (33.0, "tams_app.video.core.codecs"),
}
_REMOVED: dict[
    str, tuple[Any, ...]
] = {  # what takes its place; values that ask for nothing, ...: any
    "--metrics": (_METRICS,),
    "recording.metrics": (_METRICS, ""),
    "doctor --speed": (f"a session says at its end where frames were missing: {_FPS}",),
    "replay --recompute": (
        "what the code makes of a recorded session is compared by its tests alone "
        "(tests/session/test_recompute.py); leave it out to see the session",
    ),
    "rig.fixed_fps": (_FPS, False, True),
    "arm.servo": ("the arm follows velocities; leave it out", "velocity"),
    "controller.input": (
        "SteamVR's actions are read where it has them; leave it out",
        "auto",
        "actions",
    ),
    "video.encoder": ("x264 encodes; leave it out", "x264enc", "x264", "auto"),
    "video.decoder": ("avdec decodes; leave it out", "avdec_h264", "avdec", "auto"),
    "video.bind_host": ("streams stay on this computer; leave it out", "127.0.0.1"),
    "video.first_port": ("streams take any free ports; leave it out", 0),
    "policy.tams_plus": ("`tams+` has no parts to switch any more; leave it out", ...),
    "sounds": ("window, headset and terminal show each hold and fault; leave it out",),
    "gamepad": (_PADS,),
    "spacemouse": (_PADS,),
    "controller.desk.dead_zone": (_PADS, 0.12),
    "controller.desk.name": (_PADS, ""),
    "controller.desk.wireless": (_PADS,),
    "controller.desk.unchanged_ms": (_PADS, 500.0),
    "focus": (_CAMERAS,),
    "exposure": (_CAMERAS,),
    "rate": (_CAMERAS,),
    "calibrate cameras --from": (_CAMERAS,),
    "calibrate --figure": (_CALIBRATED,),
    "calibrate --picture": (_CALIBRATED,),
    "calibrate frame --from": (
        "recorded strokes cannot be tried out: leave it out, and make them",
    ),
    "calibrate frame --touch": (_STROKES,),
    "calibrate frame --keep-scale": (_STROKES,),
    "calibrate weights --panel": (
        "the simulated raters are one panel, for trying the wizard out; leave it out",
    ),
    "calibrate phases --mark": (_MARKS,),
    "calibrate phases --goal-height-mm": (_MARKS,),
    "calibrate phases --yes": ("it writes without a question; leave it out",),
    "calibrate phases --figure": (_FIGURES,),
    "calibrate phases --picture": (_FIGURES,),
    **{
        key: (f"is a constant of {module} now, {value}: leave it out", value)
        for key, (value, module) in _CONSTANTS.items()
    },
    "clutch": (
        "its keys are constants of tams_app.presses now; leave it out",
        {},
        {"engage_above": 0.6},
        {"release_below": 0.4},
        {"engage_above": 0.6, "release_below": 0.4},
    ),
}
REMOVED: dict[str, str] = {key: instead for key, (instead, *_) in _REMOVED.items()}
"""By key, option (of one command, or of several) or word for a key or an option."""


def removed_keys(content: dict[str, Any]) -> dict[str, str]:
    """The removed keys that ask for something, and what takes their places."""
    return {
        key: instead
        for key, (instead, *former) in _REMOVED.items()
        if ... not in former and _at(content, key) not in (None, *former)
    }


def without_removed(content: Any) -> Any:
    """The content without any removed key."""
    for key in REMOVED:
        content = _without(content, key)
    return content


def _at(content: Any, key: str) -> Any:
    for part in key.split("."):
        content = content.get(part) if isinstance(content, dict) else None
    return content


def _without(content: Any, key: str) -> Any:
    first, _, rest = key.partition(".")
    if not isinstance(content, dict) or first not in content:
        return content
    others = {name: value for name, value in content.items() if name != first}
    return others | {first: _without(content[first], rest)} if rest else others


class Config(Section):
    """Everything a session is built from."""

    version: Literal[1]
    """Version of this format."""
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")] = "run"
    """Name of the session, part of its folder's name."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of scene, noise and losses."""
    strategy: str = "tams"
    """How the budget is divided: `equal`, `static`, `tams` or `tams+`."""
    network: str = "s2"
    """A name from networks, `none`, or the path of a capacity trace."""
    seconds: Positive | None = None
    """Length of a session; null: until it is ended."""
    headless: bool = False
    """Whether no windows are opened."""
    faces: tuple[Word, ...] = ("window", "headset")
    """What shows a session to the operator, each where it can: `window`, `headset`, or an
    installed one."""
    preset: Literal["reference"] | None = None
    """Constants that are laid over this file and the calibration: those of `reference.yaml`, of the
    nodes that the paper's authors published."""
    calibration: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] | None = None
    """The set of measured files, `calibration/NAME/` beside this file, that is laid over it."""
    calibrated_by: tuple[str, ...] = ()
    """Filled in when the configuration is read: the measured files that are in force."""
    arm: ArmConfig = ArmConfig()
    hand: HandConfig = HandConfig()
    limits: LimitsConfig = LimitsConfig()
    freshness: FreshnessConfig = FreshnessConfig()
    control: ControlConfig = ControlConfig()
    controller: ControllerConfig = ControllerConfig()
    headset: HeadsetConfig = HeadsetConfig()
    cameras: dict[str, CameraConfig] = Field(default_factory=dict)
    """The cameras by view; the simulated rig brings its own."""
    policy: PolicyConfig
    video: VideoConfig = VideoConfig()
    view: ViewConfig = ViewConfig()
    networks: dict[str, Network]
    """Uplink conditions by name."""
    link: LinkConfig = LinkConfig()
    rig: RigConfig = RigConfig()
    trial: TrialConfig = TrialConfig()
    study: StudyConfig = StudyConfig()
    recording: RecordingConfig = RecordingConfig()
    ros2: Ros2Config = Ros2Config()

    @property
    def operator_is_simulated(self) -> bool:
        """True if the operator at this computer is the rig's, and no person."""
        return self.rig.enabled and self.controller.device in ("auto", "sim")

    @property
    def hand_is_tracked(self) -> bool:
        """True if the operator at this computer holds a controller that SteamVR tracks."""
        device = self.controller.device
        return device == "openvr" or (device == "auto" and not self.rig.enabled)

    @model_validator(mode="before")
    @classmethod
    def _of_any_version(cls, given: Any) -> Any:
        """Logs of earlier versions have keys that were removed since; files are refused."""
        return without_removed(given)

    @model_validator(mode="after")
    def _sections_fit_together(self) -> Self:
        if self.controller.device == "sim" and not self.rig.enabled:
            raise ValueError("controller.device sim is for the simulated rig: add --sim")
        if self.controller.device == "keyboard" and self.headless:
            raise ValueError("controller.device keyboard needs the window: leave out --headless")
        if self.arm.guard.heartbeat_timeout_ms * self.control.rate_hz < 2000.0:
            raise ValueError(
                "arm.guard.heartbeat_timeout_ms must be at least two periods of control.rate_hz, "
                f"{2000.0 / self.control.rate_hz:.0f} ms, or the guard stops the arm between them"
            )
        self._check_views("policy.weights.matrix", self.policy.weights.matrix[Phase.REACH])
        self._check_views("policy.allocation.static_weights", self.policy.allocation.static_weights)
        if not self.rig.enabled:
            self._check_views("cameras", self.cameras)
        return self

    def _check_views(self, key: str, names: Iterable[str]) -> None:
        """ValueError unless the names are those of `video.views`."""
        views, given = self.video.views, list(names)
        for name in given:
            if name not in views:
                raise ValueError(f"{key}: {not_one_of(name, views)} (video.views)")
        if lacking := [view for view in views if view not in given]:
            raise ValueError(f"{key} lacks {', '.join(lacking)} of video.views")
