"""What a session shows at one moment: one account of its records, while it runs and of its log."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from tams_app.capacity import finite
from tams_app.policy.weights import WeightMatrix
from tams_app.records import (
    Allocation,
    CameraRates,
    EpisodesState,
    LinkCapacity,
    Newest,
    PhaseChange,
    PinnedView,
    Placed,
    SessionState,
    StopRecord,
    Tick,
    Vector,
    ViewState,
)
from tams_app.video.core.uplink_figures import UplinkFigures


class StateMaker:
    """Makes the states of one session out of its newest records."""

    def __init__(self, views: tuple[str, ...], weights: WeightMatrix | None, fps: float) -> None:
        """`weights`: None: they are not known. `fps`: asked of each camera."""
        self._views, self._weights, self._fps = views, weights, fps

    def state(
        self,
        newest: Newest,
        t_s: float,
        figures: UplinkFigures,
        views: Mapping[str, ViewState],
        hand: str,
        episodes: EpisodesState | None,
    ) -> SessionState:
        """The state without the time that it is shown at.

        Args:
            newest: the records; from any thread.
            t_s: time since the session's start [s].
            figures: of the uplink in the last second.
            views: by view, what none of these has: ages, latency, what was shown, and what the
                camera gave where that is not recorded.
            hand: of `tams_app.teleop.hands.HANDS`, "" while it is not known.
            episodes: None: the session has none.

        Returns:
            The state; a value that nothing is known of is as `SessionState` has it by default.
        """
        tick, allocation, placed = newest.of(Tick), newest.of(Allocation), newest.of(Placed)
        capacity, stop = newest.of(LinkCapacity), newest.of(StopRecord)
        change, rates, pin = newest.of(PhaseChange), newest.of(CameraRates), newest.of(PinnedView)
        pinned = "" if pin is None else pin.view
        primary = self._weights and change and self._weights.primary_view(change.phase, pinned)
        targets = {} if allocation is None else allocation.target_kbps
        state = SessionState(
            t_s=t_s,
            arming="starting",
            last_stop="" if stop is None else stop.reason,
            hand=hand,
            phase="" if change is None else change.phase.value,
            primary_view=primary or "",
            is_pinned=bool(pinned) and primary == pinned,
            views={
                view: msgspec.structs.replace(
                    views[view],
                    target_kbps=targets.get(view),
                    sent_kbps=figures.sent_kbps[view],
                    given_fps=views[view].given_fps if rates is None else rates.given_fps.get(view),
                )
                for view in self._views
            },
            link_kbps=figures.link_kbps,
            queue_ms=figures.queue_ms,
            loss=figures.loss,
            budget_kbps=None if allocation is None else finite(allocation.budget_kbps),
            estimate_kbps=None if allocation is None else finite(allocation.capacity_kbps),
            capacity_kbps=None if capacity is None else finite(capacity.capacity_kbps),
            asked_fps=self._fps,
            episodes=episodes,
            placed=placed is not None and placed.placed,
        )
        return state if tick is None else _with_tick(state, tick)


def _with_tick(state: SessionState, tick: Tick) -> SessionState:
    arm = tick.arm
    return msgspec.structs.replace(
        state,
        arming=tick.arming,
        reason=tick.reason,
        lasting=tick.lasting,
        deadman=tick.deadman,
        orientation_mode=tick.orientation_mode,
        pressed=tick.controller.pressed,
        speed_scale=tick.speed_scale,
        gripper_closed=None if arm is None else arm.gripper_closed,
        tcp_mm=None if arm is None else _mm(arm.tcp.position),
        joints_urad=() if arm is None else _urad(arm.joints),
        joints_ns=0 if arm is None else arm.received_ns,
        hottest_motor_c=None if arm is None else arm.hottest_motor_c,
    )


def _urad(joints: Vector) -> tuple[int, ...]:
    return tuple(np.rint(joints * 1e6).astype(int).tolist())


def _mm(position: Vector) -> tuple[float, float, float]:
    x, y, z = (position * 1000.0).tolist()
    return x, y, z
