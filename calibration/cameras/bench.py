"""What the steps of the wizard need of the cameras, whether real or simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from enum import Enum, auto
from typing import Protocol, TypeAlias

from calibration.cameras.flashes import Flashes
from calibration.ui import WizardUI
from tams_app.config import CameraConfig
from tams_app.records import Frame, Vector

_CHUNK_S = 0.5

Arm: TypeAlias = Callable[[], Vector | None]
"""The arm's newest joints [rad], shape (6,); None: it has not reported lately."""


class Task(Enum):
    """What the person is asked to do; a simulated one does it."""

    REST = auto()  # keep out of sight, hold still
    WAVE = auto()  # a hand before one camera
    SHOW_SCREEN = auto()  # point it at the screen that flashes
    SHOW_BOARD = auto()  # hold the board before one camera, from many sides
    MOVE_ARM = auto()  # the board lies still, the arm goes to many poses
    MOVE_BOARD = auto()  # the board goes to another place


class Bench(Protocol):
    """All cameras of the machine, open; close it in the end.

    `attended`: a person does what is prompted, and is asked; else `done` shows when a simulated
    one has finished.
    """

    source: str  # where it all comes from, for the calibration's provenance
    attended: bool
    fps: int
    width: int  # of the pictures
    height: int

    @property
    def cameras(self) -> Sequence[str]:
        """The candidates, as people call them."""

    @property
    def refused(self) -> Sequence[str]:
        """The cameras that cannot be used, a sentence each."""

    def binding(self, camera: str) -> dict[str, str]:
        """The configuration's keys that choose this camera."""

    def camera_of(self, config: CameraConfig) -> str:
        """The candidate that a configuration chooses, "" if none."""

    def prompt(self, task: Task, view: str) -> None:
        """The person has been asked; `view` is the one meant, "" for all."""

    @property
    def done(self) -> bool:
        """Whether a simulated person has finished what was asked last."""

    def shots(self, cameras: Sequence[str], seconds: float, every: int = 1) -> Iterator[Frame]:
        """The frames of some cameras as they come for so long; each `every`-th only.

        The view of a frame is here the camera, as people call it.
        """

    def screen(self) -> AbstractContextManager[Flashes]:
        """Let a screen flash; SetupError where there is no display."""

    def arm(self) -> AbstractContextManager[Arm]:
        """Listen to the arm, which nothing here moves; DeviceError if it does not report."""

    def close(self) -> None:
        """Let go of all cameras; may be called twice."""


def until_done(
    ui: WizardUI, bench: Bench, cameras: Sequence[str], most_s: float, every: int = 1
) -> Iterator[Frame]:
    """Frames until Enter is pressed, a simulated person has finished, or `most_s` are over."""
    for _ in range(round(most_s / _CHUNK_S)):
        yield from bench.shots(cameras, _CHUNK_S, every)
        if ui.pressed() or bench.done:
            return


def agreed(ui: WizardUI, bench: Bench, question: str) -> bool:
    """The person's answer; no where only a simulated person or no terminal is there."""
    return bench.attended and ui.attended and ui.yes(question)
