"""The real devices beside the arm: the tracked controller and the cameras."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tams_app.config.section import Positive, Section

# A part of a controller and what is read of it, as SteamVR names them: `trigger/pull`, `a/click`.
ComponentPath = Annotated[str, Field(pattern=r"^[a-z_]+/[a-z]+$")]
ControllerType = Literal["vive_focus3_controller", "vive_controller", "knuckles"]


class MappingConfig(Section):
    """Which component plays each part; None leaves it to the default of the controller's type."""

    trigger: ComponentPath | None = None  # deadman and clutch, analog
    grip: ComponentPath | None = None  # toggles translation/orientation
    a: ComponentPath | None = None  # closes the gripper
    b: ComponentPath | None = None  # opens it
    menu: ComponentPath | None = None  # held: confirm; clicked: emergency stop

    @model_validator(mode="after")
    def _leaves_the_system_button(self) -> Self:
        for role, path in self.model_dump(exclude_none=True).items():
            if path.startswith("system/"):
                raise ValueError(f"{role} cannot be the system button, SteamVR keeps it to itself")
        return self


class ControllerConfig(Section):
    """The tracked VR controller, over OpenVR."""

    hand: Literal["right", "left"] = "right"
    # actions: SteamVR Input, which the operator can rebind; legacy: the raw controller state
    input: Literal["auto", "actions", "legacy"] = "auto"
    # Departures from the defaults, by the type that `doctor --devices` shows.
    mapping: dict[ControllerType, MappingConfig] = Field(default_factory=dict)


# What only a real camera has
_V4L2_ONLY = (
    "name",
    "serial",
    "path",
    "pixel_format",
    "exposure_us",
    "white_balance_k",
    "controls",
)


class CameraConfig(Section):
    """Where one view's frames come from."""

    source: Literal["v4l2", "file", "pattern"] = "v4l2"
    # A V4L2 device; every one of these that is given must match, so that swapped numbers show.
    name: str = ""
    serial: str = ""
    path: str = ""  # /dev/videoN or, better, a link of /dev/v4l/by-path
    file: str = ""  # a video, played again and again
    pixel_format: Literal["mjpeg", "raw"] = "mjpeg"
    exposure_us: Positive | None = None  # None leaves the automatic exposure on
    white_balance_k: Annotated[int, Field(ge=1000, le=20000)] | None = None
    # From the light to the frame's time stamp: added to the age of what the operator sees.
    latency_ms: Annotated[float, Field(ge=0, le=1000)] = 0.0
    controls: dict[str, int] = Field(
        default_factory=dict
    )  # further V4L2 controls by their names, such as gain

    @model_validator(mode="after")
    def _says_which(self) -> Self:
        if self.source == "v4l2" and not (self.name or self.serial or self.path):
            raise ValueError("a v4l2 camera needs its name, serial or path")
        if self.source == "file" and not self.file:
            raise ValueError("a file camera needs its file")
        return self

    @model_validator(mode="after")
    def _says_nothing_that_would_not_count(self) -> Self:
        foreign = {"v4l2": ("file",), "file": _V4L2_ONLY, "pattern": (*_V4L2_ONLY, "file")}
        for key in foreign[self.source]:
            field = type(self).model_fields[key]
            if getattr(self, key) != field.get_default(call_default_factory=True):
                raise ValueError(f"{key} means nothing to a {self.source} camera: take it out")
        return self
