"""What a session knows at one moment: one record for link, terminal, window, headset and replay."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import msgspec

# Of any two the difference fits into 64 bits, in which logs, figures and other languages keep them.
_BEYOND_WHOLE = 1 << 62
Whole: TypeAlias = Annotated[int, msgspec.Meta(gt=-_BEYOND_WHOLE, lt=_BEYOND_WHOLE)]

LINK_LOST = "link lost"  # in the place of a state of the arming table


class LatencyState(msgspec.Struct, frozen=True, array_like=True):
    """What a view's frames have taken lately outside the network, as far as it is known here.

    total_ms: all stages. slowest: the key of the longest of them, slowest_ms: what that took.
    """

    total_ms: Whole
    slowest: str
    slowest_ms: Whole


class ViewState(msgspec.Struct, frozen=True, array_like=True):
    """One view; None while a value is not known.

    target_kbps, sent_kbps: what it is to send, and what it has sent in the last second. given_fps,
    shown_fps: frames in the last second, of the camera, and as the operator got them. latency_ms:
    of the newest frame shown, from its capture to the mailbox. age_ms: of the newest frame shown
    that counts, since its capture. own: of its latency, what is not the network's; on the robot's
    side until the packets leave. live_ssim: of what is on the screen with what the camera sees,
    over the last scored frames; task_live_ssim: the same within the task's region.
    """

    target_kbps: float | None = None
    sent_kbps: float | None = None
    given_fps: float | None = None
    latency_ms: float | None = None
    age_ms: float | None = None
    shown_fps: float | None = None
    own: LatencyState | None = None
    live_ssim: float | None = None
    task_live_ssim: float | None = None

    @property
    def fps(self) -> float | None:
        """As shown; on the robot's side, which shows nothing, as given."""
        return self.given_fps if self.shown_fps is None else self.shown_fps


class EpisodeState(msgspec.Struct, frozen=True, array_like=True):
    """An episode that has ended. success: None: nobody said."""

    number: int
    length_s: float
    kept: bool = True
    success: bool | None = None


class EpisodesState(msgspec.Struct, frozen=True, array_like=True):
    """The episodes of a session at one moment.

    number: of the one that is recorded, or comes next. doing: idle, countdown or recording.
    seconds: until it begins, in a countdown; since it began, while it is recorded. armed: the
    request (`EpisodeRequest`) that counts if it is given once more, "" for none. kept, discarded:
    how many there are of those that have ended. last: the newest of them, in order.
    """

    number: int
    doing: str
    seconds: float = 0.0
    armed: str = ""
    kept: int = 0
    discarded: int = 0
    last: tuple[EpisodeState, ...] = ()


class SessionState(msgspec.Struct, frozen=True, array_like=True, kw_only=True):
    """A session at one moment; None while a value is not known.

    t_s: since its start. arming: the state's word. reason: why the arm does not move, "" if nothing
    holds it, as it is logged. lasting: label of what of it is still there, "" if its cause is gone.
    last_stop: label of the last stop of the recorded list, "" before the first. hand: what drives
    the arm, of `HANDS`. pressed: buttons other than the trigger. tcp_mm: in the arm's base frame.
    primary_view: the one that matters in `phase`, or that the operator has pinned (is_pinned).
    link_kbps, queue_ms, loss: of the last second, all views (`UplinkFigures`). budget_kbps: what
    the views share. capacity_kbps: what the emulated network carries now; None where it is without
    limit, or real. estimate_kbps: of the capacity, as the budget believes. asked_fps: of each
    camera. now_ns: the moment, on the clock of the side that shows it. heard_ns: how recent the
    arm's part is: the control loop's last tick, or when the last message of the robot's side came;
    None: not live. episodes: None: the session has none. placed: the block was placed, as the rig's
    judge saw it. joints_urad: the arm's joints [µrad], (): not known; joints_ns: when they were
    measured, on the clock of the robot's side. speed_scale: on the arm's speed, 0 to 1.
    hottest_motor_c: of the arm's joints [°C].
    """

    t_s: float
    arming: str
    reason: str = ""
    lasting: str | None = ""
    last_stop: str = ""
    deadman: bool | None = False
    orientation_mode: bool = False
    gripper_closed: bool | None = None
    hand: str = ""
    pressed: tuple[str, ...] = ()
    phase: str = ""
    primary_view: str = ""
    tcp_mm: tuple[float, float, float] | None = None
    views: dict[str, ViewState] = {}
    link_kbps: float | None = None
    budget_kbps: float | None = None
    capacity_kbps: float | None = None
    estimate_kbps: float | None = None
    queue_ms: float | None = None
    loss: float | None = None
    asked_fps: float | None = None
    now_ns: Whole = 0
    heard_ns: Whole | None = None
    episodes: EpisodesState | None = None
    placed: bool = False
    joints_urad: tuple[Whole, ...] = ()
    joints_ns: Whole = 0
    speed_scale: float = 1.0
    is_pinned: bool = False
    hottest_motor_c: int | None = None


def without_figures(state: SessionState) -> SessionState:
    """The state without all that reveals what is compared: rates, ages and quality."""
    return msgspec.structs.replace(
        state,
        views=dict.fromkeys(state.views, ViewState()),
        link_kbps=None,
        budget_kbps=None,
        capacity_kbps=None,
        estimate_kbps=None,
        queue_ms=None,
        loss=None,
        asked_fps=None,
        joints_urad=(),
        joints_ns=0,
        speed_scale=1.0,  # slowed by the video's age
    )
