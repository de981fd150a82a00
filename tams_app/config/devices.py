"""The real devices beside the arm: the tracked controller and the cameras."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tams_app.config.section import Finite, NonNegative, Positive, Section, Triple, Word
from tams_app.records import NO_DISTORTION, Lens, Pose
from tams_app.rotation import Rotation

# A part of a controller and what is read of it, as SteamVR names them: `trigger/pull`, `a/click`.
ComponentPath = Annotated[str, Field(pattern=r"^[a-z_]+/[a-z]+$")]
_FARTHEST_MM = 5000.0
_Pixels = Annotated[int, Field(gt=0)]
ControllerType = Literal["vive_focus3_controller", "vive_controller", "knuckles"]


class MappingConfig(Section):
    """Component of each part; null leaves it to the default of the controller's type."""

    trigger: ComponentPath | None = None
    """Deadman and clutch, analog."""
    grip: ComponentPath | None = None
    """Toggles translation and orientation."""
    a: ComponentPath | None = None
    """Closes the gripper."""
    b: ComponentPath | None = None
    """Opens the gripper."""
    menu: ComponentPath | None = None
    """Held: confirm. Clicked: emergency stop."""

    @model_validator(mode="after")
    def _leaves_the_system_button(self) -> Self:
        for role, path in self.model_dump(exclude_none=True).items():
            if path.startswith("system/"):
                raise ValueError(f"{role} cannot be the system button, SteamVR keeps it to itself")
        return self


class DeskConfig(Section):
    """The hand that the keyboard moves."""

    speed_m_s: Annotated[float, Field(gt=0, le=0.5)] = 0.12
    """Speed of the hand at full deflection."""
    turn_rad_s: Annotated[float, Field(gt=0, le=2)] = 0.8
    """How fast the hand turns at full deflection."""


class ControllerConfig(Section):
    """The controller in the operator's hand."""

    device: Word = "auto"
    """What the operator holds: `openvr`, a tracked VR controller; `keyboard`, in the console's
    window; `sim`, the simulated operator; an installed one; `auto`: sim on the rig, else openvr."""
    desk: DeskConfig = DeskConfig()
    remote_seat: bool = False
    """Whether keys may move a real arm from a remote desktop or terminal, where their release may
    come late or never."""
    hand: Literal["right", "left"] = "right"
    """Which hand's controller moves the arm."""
    mapping: dict[ControllerType, MappingConfig] = Field(default_factory=dict)
    """Departures from the default mapping, by the type that `doctor --devices` shows."""


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


class HeadsetConfig(Section):
    """The views in the operator's headset, as overlays of SteamVR."""

    show: Literal["auto", "always", "never"] = "auto"
    """Whether the headset shows them: `auto`, where the hand is `openvr`; `always`, whatever the
    operator holds; `never`. Without a display, and with `--headless`, there is nothing to see."""
    placement: Literal["world", "head"] = "world"
    """`world`: they stand in the room, in front of where the headset looked when it was put on or
    recentred; `head`: they move with the head."""
    distance_m: Annotated[float, Field(ge=0.5, le=10)] = 1.5
    """From the eyes to each view."""
    width_deg: Annotated[float, Field(ge=10, le=90)] = 40.0
    """How wide the primary view is to the eyes; the others are three fifths of it."""
    elevation_deg: Annotated[float, Field(ge=-45, le=45)] = -5.0
    """Of the primary view's centre above the level of the eyes."""


class LensConfig(Section):
    """How a camera makes its picture."""

    width: _Pixels
    """Of the pictures that it was measured in; one of another size but the same shape is scaled."""
    height: _Pixels
    """Of the pictures that it was measured in."""
    fx: Positive
    """Focal length along the rows."""
    fy: Positive
    """Focal length along the columns."""
    cx: Finite
    """Principal point; 0 is the middle of the first pixel."""
    cy: Finite
    """Principal point; 0 is the middle of the first pixel."""
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = NO_DISTORTION
    """k1, k2, p1, p2, k3 as of OpenCV, and `plumb_bob` of ROS."""
    error_px: NonNegative
    """Distance (rms) of a board's corners from where they should be, in pictures that it was not
    fitted to."""
    measured: date | None = None
    """The day."""

    @model_validator(mode="after")
    def _makes_a_picture(self) -> Self:
        if not (0 <= self.cx < self.width and 0 <= self.cy < self.height):
            raise ValueError("cx and cy must be in the picture")
        if not self.at(Pose(np.zeros(3), Rotation.identity()), "").is_invertible:
            raise ValueError("distortion turns back within the picture: measure it again")
        return self

    def at(self, pose: Pose, parent: str) -> Lens:
        """The lens at `pose` in the frame `parent`."""
        matrix = self.fx, self.fy, self.cx, self.cy
        return Lens(parent, pose, *matrix, self.width, self.height, self.distortion)


class MountConfig(Section):
    """Where a camera is."""

    frame: Literal["arm", "base"]
    """In which it stands still, and its pose is: `arm`, the flange's; `base`, the arm's base."""
    position_mm: Triple
    """Of its lens."""
    rotation_vector_rad: Triple
    """Axis times angle; turns the picture's axes (x right, y down, z forwards) to those of the
    frame."""
    error_px: NonNegative
    """Distance (rms) of a board's corners from where arm and camera have them, in poses and places
    that it was not fitted to."""
    measured: date | None = None
    """The day."""

    @model_validator(mode="after")
    def _is_near(self) -> Self:
        if max(map(abs, self.position_mm)) > _FARTHEST_MM:
            raise ValueError(
                f"position_mm: a camera is within {_FARTHEST_MM:g} mm: give millimetres"
            )
        return self

    @property
    def pose(self) -> Pose:
        """The pose in `frame` [m]."""
        turn = Rotation.from_rotvec(self.rotation_vector_rad)
        return Pose(np.array(self.position_mm) / 1000.0, turn)


class CameraConfig(Section):
    """Source of one view's frames."""

    source: Word = "v4l2"
    """What kind of camera it is: `v4l2`, `file` or `pattern`, or a word of another distribution."""
    name: str = ""
    """Name of a V4L2 device. Each one given of name, serial and path must match."""
    serial: str = ""
    """Serial number of a V4L2 device."""
    path: str = ""
    """/dev/videoN or, better, a link of /dev/v4l/by-path."""
    file: str = ""
    """A video that is played again and again at its own times, for source `file`."""
    pixel_format: Literal["mjpeg", "raw"] = "mjpeg"
    """What the camera sends: `mjpeg` fits three cameras on one USB 2 bus."""
    exposure_us: Positive | None = None
    """Exposure time; null leaves the automatic exposure on."""
    white_balance_k: Annotated[int, Field(ge=1000, le=20000)] | None = None
    """Colour temperature; null leaves the automatic white balance on."""
    controls: dict[str, int] = Field(default_factory=dict)
    """Further V4L2 controls by their names, such as gain."""
    latency_ms: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """From the light to the frame's time stamp: added to the age of what the operator sees."""
    lens: LensConfig | None = None
    """How it makes its picture, which the predictive display needs; null: not measured."""
    mount: MountConfig | None = None
    """Where it is, which the predictive display needs; null: not measured."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.source == "v4l2" and not (self.name or self.serial or self.path):
            raise ValueError("a v4l2 camera needs its name, serial or path")
        if self.source == "file" and not self.file:
            raise ValueError("a file camera needs its file")
        if self.mount is not None and self.lens is None:
            raise ValueError("mount holds with the lens through which it was measured: give both")
        foreign = {"v4l2": ("file",), "file": _V4L2_ONLY, "pattern": (*_V4L2_ONLY, "file")}
        for key in foreign.get(self.source, ()):
            field = type(self).model_fields[key]
            if getattr(self, key) != field.get_default(call_default_factory=True):
                raise ValueError(f"{key} means nothing to a {self.source} camera: take it out")
        return self
