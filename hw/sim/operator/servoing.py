"""Visual servoing as a person does it: see the error, move the hand, know what is under way.

Of the scene the mind (`hw.sim.operator.operator`) gets `Percept`s and nothing else. They come from
the received images (`hw.sim.operator.seeing`) or, in the demo, from the true scene
(`hw.sim.operator.demo`).

What operators see is late: the image travels, and the arm follows the hand with a lag. They steer
without oscillation because they count the movement they have made but not yet seen (a Smith
predictor; in people, the efference copy: Miall et al. 1993).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.vision.views import Matrix
from tams_app.config import Config, HandConfig
from tams_app.records import Pose, Vector
from tams_app.rotation import Rotation

_HORIZONTAL = 0.5  # |z| of a unit axis below which fingers can close along it


@dataclass(frozen=True, slots=True)
class GapSigmas:
    """Standard deviations of the tool as seen against block and container.

    Better known than either place where one image shows both.
    """

    block: float = 0.0  # [m]
    container: float = 0.0  # [m]
    heading: float = 0.0  # [rad], of the block against the tool


_EXACT = GapSigmas()


@dataclass(frozen=True, slots=True)
class Percept:
    """The scene as it looked at `t_ns`: when the view was captured, as far as the operator knows.

    Poses in the arm's base frame. Block and tool are their centres; of the container only x and y
    are used. `fingers_opening` [m] is None when the fingers cannot be made out. `tcp_sigma` and
    `block_sigma`: standard deviations of these places [m], infinite when out of sight.
    """

    t_ns: int
    tcp: Pose
    block: Pose
    container: Pose
    fingers_opening: float | None
    tcp_sigma: float = 0.0
    block_sigma: float = 0.0
    gaps: GapSigmas = _EXACT


class Perception(Protocol):
    """The operator's eyes."""

    def look(self, now_ns: int) -> Percept | None:
        """The newest view at `now_ns`, None while there is nothing to see; does not block."""


class HandMap:
    """The operator's belief of the map from the hand's motion to the tool's; wrong by a little."""

    def __init__(
        self, config: HandConfig, traits: ParticipantProfile, random: np.random.Generator
    ) -> None:
        """`traits`: how well directions and scale are known."""
        misjudged = Rotation.from_rotvec(random.normal(0.0, traits.misjudged_rad, 3)).as_matrix()
        rotation = misjudged @ np.array(config.rotation)
        scale = 1.0 + random.normal(0.0, traits.misjudged_scale)
        # Matrices, shape (3, 3): from the hand's displacement or turn to the tool's, and back.
        self.tool_linear: Matrix = scale * config.translation_scale * rotation
        self.tool_angular: Matrix = scale * config.rotation_scale * rotation
        self.hand_linear: Matrix = np.linalg.inv(self.tool_linear)
        self.hand_angular: Matrix = np.linalg.inv(self.tool_angular)


def operator_hand(config: Config) -> HandConfig:
    """The true map of the rig's operator to the arm, whatever teleoperation maps by."""
    if config.rig.hand_rotation is None:
        return config.hand
    return config.hand.model_copy(update={"rotation": config.rig.hand_rotation})


@dataclass(frozen=True, slots=True)
class ViewSight:
    """A view, and the tool's motion since, as far as the hand knows of it."""

    percept: Percept
    moved: Vector  # [m]
    turned: Vector  # [rad]

    @property
    def tcp(self) -> Vector:
        """The expected place of the tool by now [m], base frame."""
        return self.percept.tcp.position + self.moved

    @property
    def block(self) -> Vector:
        """The place where the block was seen [m], base frame."""
        return self.percept.block.position


def norm(vector: Vector) -> float:
    """Length of `vector`."""
    return math.sqrt(vector @ vector)


def approach(error: Vector, speed: float, gain_per_s: float) -> Vector:
    """The velocity [m/s] that closes `error` [m]: at most `speed`, gently at the end.

    Closing a fixed part of the remaining distance per second is Fitts's law: halving it costs the
    same time however far it is, so the gain is ln 2 times the throughput [bit/s].
    """
    wanted = gain_per_s * norm(error)
    return gain_per_s * error * (speed / wanted if wanted > speed else 1.0)


def speed_factor(sigma: float, tolerance: float) -> float:
    """The part of full speed, 0..1, at which an operator moves who is uncertain by `sigma`.

    All of it up to `tolerance`, nothing from twice the tolerance on: they wait for a better view.
    """
    return min(1.0, max(0.0, 2.0 - sigma / tolerance))


def grasp_turn(tool: Rotation, block: Rotation) -> Vector:
    """The rotation vector [rad] that brings the gripper down onto the block, base frame.

    The fingers close along the tool's y axis. The block is 20 mm along its own z, too long for
    them, so they take its x or y axis, whichever lies flat and needs the smaller turn.
    """
    tool_axes = tool.as_matrix()
    block_axes = block.as_matrix()
    flat = [axis for axis in (block_axes[:, 0], block_axes[:, 1]) if abs(axis[2]) < _HORIZONTAL]
    heading = _azimuth(tool_axes[:, 1])
    turns = [_half_turn(_azimuth(axis) - heading) for axis in flat]
    pointing = tool_axes[:, 2]  # its cross product with straight down is the tilt
    return np.array([-pointing[1], pointing[0], min(turns, key=abs, default=0.0)])


def _azimuth(axis: Vector) -> float:
    return math.atan2(axis[1], axis[0])


def _half_turn(angle: float) -> float:
    """`angle` [rad] reduced to ±90°: an axis has no direction."""
    return (angle + math.pi / 2) % math.pi - math.pi / 2
