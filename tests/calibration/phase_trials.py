"""Pick-and-place trials made by arithmetic: paths whose phases are known by construction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.phases.fit import StepInput, TrialMotion
from calibration.phases.labels import Geometry
from tams_app.records import Activity, ArmState, Pose, SceneTruth, ServoMode, Tick
from tams_app.rotation import Rotation
from tests.synthetic_session import header, tick, write_log

PERIOD_S = 1.0 / 120.0
BLOCK = np.array([0.35, -0.15, 0.010])
CONTAINER = np.array([0.33, 0.18, 0.0])
START = np.array([0.30, 0.0, 0.20])
NO_TURN = Rotation.identity()


@dataclass(frozen=True)
class Leg:
    """The tool goes in a straight line to `to` [m] within `seconds`, then the gripper is told."""

    seconds: float
    to: tuple[float, float, float]
    then_closed: bool | None = None


def over(place: np.ndarray, height: float) -> tuple[float, float, float]:
    return (float(place[0]), float(place[1]), height)


PICK = (
    Leg(1.0, over(BLOCK, 0.15)),
    Leg(0.4, over(BLOCK, 0.15)),  # stands above the block, as while turning
    Leg(1.0, over(BLOCK, 0.011)),
    Leg(0.2, over(BLOCK, 0.011), then_closed=True),
    Leg(0.3, over(BLOCK, 0.011)),
    Leg(0.8, over(BLOCK, 0.13)),
)
PLACE = (
    Leg(1.5, over(CONTAINER, 0.13)),
    Leg(0.8, over(CONTAINER, 0.026)),
    Leg(0.2, over(CONTAINER, 0.026), then_closed=False),
    Leg(0.3, over(CONTAINER, 0.026)),
    Leg(0.8, over(CONTAINER, 0.13)),
)
WHOLE = PICK + PLACE


@dataclass
class Path3:
    """What a path does: tool [m], shape (n, 3), gripper, and the block that it carries."""

    tool: np.ndarray
    closed: np.ndarray
    block: np.ndarray

    def geometry(self) -> Geometry:
        beside = np.abs((self.block - CONTAINER)[:, :2]).max(axis=1)
        return Geometry(self.tool, self.block, beside <= 0.045, self.closed, 0.010)


def walk(legs: tuple[Leg, ...], *, carries: bool = True) -> Path3:
    """The legs in turn from START; a block between closing fingers comes along if `carries`."""
    tool, closed = [START], [False]
    for leg in legs:
        steps = round(leg.seconds / PERIOD_S)
        begin = tool[-1]
        for step in range(1, steps + 1):
            tool.append(begin + (np.array(leg.to) - begin) * step / steps)
            closed.append(closed[-1])
        if leg.then_closed is not None:
            closed[-1] = leg.then_closed
    block, grip = [BLOCK], None
    for place, shut in zip(tool[1:], closed[1:], strict=True):
        near = np.linalg.norm(place - block[-1]) < 0.02
        if not shut:
            grip = None
            rest = block[-1].copy()
            rest[2] = 0.012 if np.abs((rest - CONTAINER)[:2]).max() < 0.045 else 0.010
            block.append(rest)
        else:
            if grip is None and near and carries:
                grip = block[-1] - place
            block.append(block[-1] if grip is None else place + grip)
    return Path3(np.array(tool), np.array(closed), np.array(block))


def session(
    path: Path3, lead_s: float = 0.5, every: int = 1
) -> tuple[list[Tick], list[SceneTruth]]:
    """Ticks and scene of a path, after `lead_s` in which the arm does not follow yet.

    `every`: 4 keeps each fourth tick only, for what searches them: it takes its time.
    """
    lead = round(lead_s / PERIOD_S)
    ticks, scene = [], []
    for number in range(0, lead + len(path.tool), every):
        at = max(0, number - lead)
        base = tick(number)
        pose = Pose(path.tool[at], NO_TURN)
        arm = ArmState(
            base.started_ns,
            np.zeros(6),
            pose,
            Activity.MOVING,
            ServoMode.VELOCITY,
            None,
            gripper_closed=bool(path.closed[at]),
        )
        engaged = number >= lead
        ticks.append(
            replace(base, arm=arm, deadman=engaged, arming="engaged" if engaged else "ready")
        )
        if number % 4 == 0:
            block = Pose(path.block[at], NO_TURN)
            scene.append(
                SceneTruth(base.started_ns, block, Pose(CONTAINER, NO_TURN), pose, 0.0, 0.016)
            )
    return ticks, scene


def record(folder: Path, ticks: list[Tick], scene: list[SceneTruth], rig: bool = True) -> Path:
    """A session folder with these records in its log; `rig`: of the simulated rig."""
    folder.mkdir()
    begun = header(config={"rig": {"enabled": rig}})
    write_log(folder / "session.mcap", (*ticks, *scene), begun)
    return folder


def motion(seed: int, noise_mm_s: float = 0.0) -> TrialMotion:
    """About six seconds of speeds with ramps, pauses, descents and two edges of the gripper.

    30 ticks a second: the search takes its time.
    """
    period_s = 4.0 * PERIOD_S
    random = np.random.default_rng(seed)
    # seconds, speed and vertical speed at the end [mm/s], gripper
    parts = [
        (0.8, 90.0, -4.0, False),
        (0.5, 70.0, -45.0, False),
        (0.4, 20.0, 0.0, False),
        (0.9, 50.0, -48.0, False),
        (0.4, 0.5, 0.0, False),
        (0.4, 0.5, 0.0, True),
        (0.4, 60.0, 55.0, True),
        (0.7, 100.0, -8.0, True),
        (0.9, 45.0, -42.0, True),
        (0.3, 2.0, -1.0, True),
        (0.5, 1.0, 0.0, False),
        (0.5, 50.0, 45.0, False),
    ]
    inputs: list[StepInput] = [(0.0, 0.0, False, 0.0)]
    speed = vertical = 0.0
    for seconds, speed_to, vertical_to, closed in parts:
        steps = round(seconds * random.uniform(0.7, 1.3) / period_s)
        scale = random.uniform(0.7, 1.3)
        for step in range(1, steps + 1):
            part = step / steps
            wobble = noise_mm_s * random.standard_normal(2)
            v = max(0.0, speed + (speed_to * scale - speed) * part + wobble[0])
            vz = vertical + (vertical_to * scale - vertical) * part + wobble[1]
            inputs.append((v / 1000, vz / 1000, closed, period_s))
        speed, vertical = speed_to * scale, vertical_to * scale
    t_s = np.arange(len(inputs)) * period_s
    return TrialMotion(f"made {seed}", t_s, tuple(inputs))
