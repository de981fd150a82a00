"""The real devices beside the arm: the tracked controller and the cameras."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tams_app.config.section import Positive, Section


class ControllerConfig(Section):
    """The tracked VR controller, over OpenVR."""

    hand: Literal["right", "left"] = "right"
    # actions: SteamVR Input, which the operator can rebind; legacy: the raw controller state
    input: Literal["auto", "actions", "legacy"] = "auto"


class CameraConfig(Section):
    """Where one view's pictures come from."""

    source: Literal["v4l2", "file", "pattern"] = "v4l2"
    # A V4L2 device; every one of these that is given must match, so that swapped numbers show.
    name: str = ""
    serial: str = ""
    path: str = ""  # /dev/videoN or, better, a link of /dev/v4l/by-path
    file: str = ""  # a video, played again and again
    pixel_format: Literal["mjpeg", "raw"] = "mjpeg"
    exposure_us: Positive | None = None  # None leaves the automatic exposure on
    white_balance_k: Annotated[int, Field(ge=1000, le=20000)] | None = None
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
