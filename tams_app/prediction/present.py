"""What is shown of a late frame: corrected to the present, where that can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import msgspec
import numpy as np

from tams_app.prediction.forward_model import ArmHeard, ForwardModel, Trail
from tams_app.prediction.outline import ArmLink, ArmOutline, PlacedArm
from tams_app.prediction.plane_warp import WristWarp
from tams_app.records import (
    ArmFigure,
    ControllerSample,
    Image,
    Lens,
    MountPrediction,
    Pose,
    Solid,
    Vector,
)
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import ZERO, Floats3

PREDICTED_FACT = "predicted_views"  # names of those that are corrected, joined by commas
OLDEST_NS = 500 * NS_PER_MS  # a frame that is older is shown as received
_KEPT_NS = 5 * NS_PER_S  # quality is measured until so long after a capture
_EACH_NS = 12 * NS_PER_MS
_AHEAD_NS = 20 * NS_PER_MS  # until the next belief comes, the last motion goes on
_BEYOND_NS = 50 * NS_PER_MS  # the newest state: further ahead nothing is believed
UNKNOWN_JOINTS: Vector = np.full(6, np.nan)


class AsReceived(StrEnum):
    """Why a frame is shown as it was received, in the words of its view's title."""

    OLD = "too old"
    UNKNOWN = "arm not known"
    UNSURE = "prediction off"
    HORIZON = "tilted too far"  # the camera sees more than the table
    MISFIT = "calibration off"  # of the camera: its frames say so


class Correction(StrEnum):
    """What was made of a frame, in the words of its view's title."""

    PREDICTED = "predicted"
    OUTLINE = "outline: now"


@dataclass(frozen=True, slots=True)
class Shown:
    """A frame as it is shown.

    correction: None for one as it was received. as_received: why it could not be corrected; None:
    it was, or there is nothing to correct.
    """

    image: Image
    correction: Correction | None = None
    as_received: AsReceived | None = None


@dataclass(frozen=True, slots=True)
class Believed:
    """Where arm and mount were believed to be at a time, and the rest of `MountPrediction`.

    commanded: the mount's own pose where it is not known.
    """

    arm: PlacedArm
    commanded: Pose
    trusted: bool
    closed: bool
    camera_fits: bool


class MountTrail:
    """Where a camera's mount was over the last seconds, and where it was believed to be then."""

    def __init__(self) -> None:
        self._then, self._now = Trail(_KEPT_NS), Trail(_KEPT_NS)
        self._quaternion: Vector = np.zeros(4)
        self.offset_ns = 0  # of the newest

    def add(self, placed: MountPrediction) -> None:
        """What is known from now on; the same place may be told again."""
        self.offset_ns = placed.offset_ns
        then = self._numbers(placed.then)
        self._then.add(placed.then_ns, np.concatenate((then, _numbers6(placed.then_joints))))
        beside = [float(one) for one in (placed.trusted, placed.closed, placed.camera_fits)]
        now = self._numbers(placed.now)
        commanded = now if placed.commanded is None else self._numbers(placed.commanded)
        joints = _numbers6(placed.now_joints)
        self._now.add(placed.now_ns, np.concatenate((now, joints, commanded, beside)))

    def then(self, t_ns: int, beyond_ns: int = _BEYOND_NS) -> PlacedArm | None:
        """Where it was; None: not known. `beyond_ns`: the newest state may be older by so much."""
        known = self._then.covers(t_ns, beyond_ns)
        return _placed(self._then.at(t_ns)) if known else None

    def now(self, now_ns: int) -> Believed | None:
        """Where it is believed to be, or was, at `now_ns`; None: not known."""
        if not self._now.covers(now_ns, _BEYOND_NS):
            return None
        found = self._now.at(now_ns, _AHEAD_NS)
        beside = (bool(one > 0.5) for one in found[20:])
        return Believed(_placed(found[:13]), _pose(found[13:20]), *beside)

    @property
    def closed(self) -> bool:
        """Whether the gripper is, by the newest belief; IndexError before the first."""
        return bool(self._now.newest[1][21] > 0.5)

    def _numbers(self, pose: Pose) -> Vector:
        """Position and quaternion: of the two of a rotation the one that is near the last one."""
        quaternion = np.array(pose.rotation)
        sign = -1.0 if quaternion @ self._quaternion < 0.0 else 1.0
        self._quaternion = sign * quaternion
        return np.concatenate((pose.position, self._quaternion))


def _pose(numbers: Vector) -> Pose:
    return Pose(numbers[:3], Rotation.from_quat(numbers[3:]))


def _numbers6(joints: Vector | None) -> Vector:
    return UNKNOWN_JOINTS if joints is None else joints


def _placed(numbers: Vector) -> PlacedArm:
    joints = numbers[7:]
    return PlacedArm(_pose(numbers[:7]), None if np.isnan(joints).any() else joints)


class Present:
    """Tells where the mount is, from each sample that is sent and each state that is received."""

    def __init__(
        self,
        model: ForwardModel,
        figure: ArmFigure,
        tell: Callable[[MountPrediction], None],
        camera_fits: Callable[[], bool],
    ) -> None:
        """`figure`: of the arm, whose flange is the mount; `tell` gets each belief.

        `camera_fits`: whether the camera on the mount is where it should be, by its frames so far.
        """
        self._model, self._figure, self._tell = model, figure, tell
        self._camera_fits = camera_fits
        self._then: tuple[ArmHeard, Pose, int, bool] | None = None
        self._sent_ns = 0
        self._failed = False
        self.on_failure: Callable[[Exception], None] | None = None
        """Gets a failure, after which nothing is told any more; None: it is raised."""

    def sent(self, sample: ControllerSample, now_ns: int) -> None:
        """A sample is on its way; from now on the arm is believed to be where it leads.

        Of 120 samples a second each second one is taken: the rest would cost, and tell no more.
        """
        if 0 <= now_ns - self._sent_ns < _EACH_NS or self._failed:
            return
        self._sent_ns = now_ns
        with self._spared():
            self._follow(sample, now_ns)

    def _mount(self, joints: Vector) -> Pose:
        return self._figure.place(joints)[self._figure.flange]

    def _follow(self, sample: ControllerSample, now_ns: int) -> None:
        self._model.sent(sample, now_ns)
        forecast = self._model.at(now_ns)
        if forecast is None or self._then is None:
            return
        state, then, offset_ns, closed = self._then
        self._tell(
            MountPrediction(
                state.t_ns + offset_ns,
                then,
                now_ns,
                self._mount(forecast.joints),
                trusted=forecast.is_trusted,
                offset_ns=offset_ns,
                closed=closed,
                camera_fits=self._camera_fits(),
                commanded=self._mount(forecast.commanded),
                then_joints=state.joints,
                now_joints=forecast.joints,
            )
        )

    def heard(self, state: ArmHeard, way_ns: int, offset_ns: int = 0, closed: bool = False) -> None:
        """A state was received.

        Args:
            state: with times of our clock.
            way_ns: as for `ForwardModel`.
            offset_ns: the clock that frames are captured by, minus ours.
            closed: the gripper is.
        """
        with self._spared():
            if not self._failed and self._model.heard(state, way_ns):
                self._then = state, self._mount(state.joints), offset_ns, closed

    @contextmanager
    def _spared(self) -> Iterator[None]:
        """What sends samples and receives states goes on without what only a screen needs."""
        try:
            yield
        except Exception as error:
            if self.on_failure is None:
                raise
            self._failed = True
            self.on_failure(error)


class CorrectedView:
    """A view whose late frames are shown with what is believed of the present.

    That of a camera on the arm as it would look now; that of one that stands still with the outline
    of the arm as it is now, and where it is led.
    """

    def __init__(self, drawing: WristWarp | ArmOutline, trail: MountTrail) -> None:
        self._drawing, self._trail = drawing, trail

    def show(self, image: Image, capture_ns: int, now_ns: int) -> Shown:
        """`image`, grey or BGR, as it is shown now; as received where that is not known.

        Args:
            image: shape (height, width) or (height, width, 3); it stays as it is.
            capture_ns: when it was captured, on the clock of `MountPrediction.then_ns`.
            now_ns: when it is shown, on the clock of `MountPrediction.now_ns`.
        """
        if now_ns + self._trail.offset_ns - capture_ns > OLDEST_NS:
            return Shown(image, as_received=AsReceived.OLD)
        then, now = self._trail.then(capture_ns), self._trail.now(now_ns)
        if then is None or now is None:
            return Shown(image, as_received=AsReceived.UNKNOWN)
        if not now.trusted:
            return Shown(image, as_received=AsReceived.UNSURE)
        if isinstance(self._drawing, ArmOutline):
            drawn = self._drawing.over(image, then, now.arm, now.commanded)
            return Shown(image) if drawn is None else Shown(drawn, Correction.OUTLINE)
        if not now.camera_fits:
            return Shown(image, as_received=AsReceived.MISFIT)
        warped = self._drawing.to_now(image, then.mount, now.arm.mount, now.closed)
        if warped is None:
            return Shown(image, as_received=AsReceived.HORIZON)
        return Shown(warped, Correction.PREDICTED)

    def luma(self, luma: Image, capture_ns: int, now_ns: int) -> Image:
        """The luma of what is shown of a frame."""
        return self.show(luma, capture_ns, now_ns).image


class WristView(CorrectedView):
    """The view of a camera on the arm, which can also be drawn from where the arm has been."""

    def __init__(self, warp: WristWarp, trail: MountTrail) -> None:
        super().__init__(warp, trail)
        self._warp = warp

    def measured(self, t_ns: int) -> Pose | None:
        """Where the mount was, by the states before and after; None: not known.

        `t_ns`: on the clock of the captures.
        """
        then = self._trail.then(t_ns, beyond_ns=0)
        return None if then is None else then.mount

    def between(self, image: Image, then: Pose, now: Pose) -> Image | None:
        """`image`, taken with the mount at `then`, as seen from `now`; None: it cannot be.

        The gripper is as it is by the newest belief, of which there must be one.
        """
        return self._warp.to_now(image, then, now, self._trail.closed)


class PredictedCamera(msgspec.Struct, frozen=True):
    """A camera, and the arm that it sees; msgspec needs the hooks `numbers_of` and `array_of`.

    lens: in the frame of the arm's mount if `on_arm`, with which it moves then; else of the base.
    tool, grip: in the frame of the mount; the latter is what closed fingers cover besides. tip: the
    TCP [m], in that frame. links: those before the mount, of a camera that stands still.
    """

    lens: Lens
    tool: tuple[Solid, ...]
    grip: tuple[Solid, ...] = ()
    on_arm: bool = True
    tip: Floats3 = ZERO
    links: tuple[ArmLink, ...] = ()

    def view(self, trail: MountTrail) -> CorrectedView:
        """What corrects its frames; `trail`: of the mount."""
        if self.on_arm:
            return WristView(WristWarp(self.lens, self.tool, self.grip), trail)
        return CorrectedView(ArmOutline(self.lens, self.tool, self.tip, self.links), trail)


def numbers_of(array: Vector) -> list[float]:
    """A pose's position as msgspec encodes it."""
    numbers: list[float] = array.tolist()
    return numbers


def array_of(_type: type, numbers: Any) -> Vector:
    """The position again."""
    position = np.array(numbers, float)
    if position.shape != (3,):
        raise ValueError(f"a position has three numbers, not {numbers}")
    return position
