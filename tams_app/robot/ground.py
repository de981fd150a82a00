"""What the parts of the robot's side stand on, and what those of a live session have besides."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.robot.control import Signals
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Ending, Parts


@dataclass(frozen=True, slots=True)
class Ground:
    """Live and virtual."""

    config: Config
    clock: Clock
    log: Journal
    signals: Signals


@dataclass(frozen=True, slots=True)
class LiveGround(Ground):
    """Live: with threads and processes; its end may come at any time.

    arm_at_once: the arming needs no confirmation. dry_run: everything but motion, the arm's
    commands go to a model of it.
    """

    parts: Parts
    ending: Ending  # of the session
    arm_at_once: bool = False
    dry_run: bool = False
