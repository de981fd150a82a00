"""The state of a running session, collected from the threads that know it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from tams_app.capacity import Capacity, finite
from tams_app.policy.weights import WeightMatrix
from tams_app.records import (
    Allocation,
    ArmState,
    ControllerSample,
    EpisodesState,
    LatencyState,
    PacketRecord,
    Phase,
    PhaseChange,
    PinnedView,
    SessionState,
    StopRecord,
    Tick,
    UplinkSummary,
    Vector,
    ViewState,
)
from tams_app.robot.control import ShownVideo, describe, lasting_label
from tams_app.robot.listener import Listener
from tams_app.robot.uplink_meter import WINDOW_NS, UplinkMeter
from tams_app.teleop.records import TeleopOutput
from tams_app.units import NS_PER_MS
from tams_app.video.core.uplink_figures import uplink_figures


class StatusBoard(Listener):
    """Written by control, policy and relay threads, read by console and link."""

    def __init__(self, views: tuple[str, ...], weights: WeightMatrix, asked_fps: float) -> None:
        """`asked_fps`: of each camera."""
        self._views, self._weights, self._asked_fps = views, weights, asked_fps
        self._phase, self._pinned = Phase.REACH, ""
        self._allocation: Allocation | None = None
        self._output: TeleopOutput | None = None
        self._arm: ArmState | None = None
        self._sample: ControllerSample | None = None
        self._received_ns: int | None = None
        self._last_stop = ""
        self.placed = False  # the block, as the judge saw it
        self._uplink = UplinkMeter(views)
        self._figures = uplink_figures((), views, WINDOW_NS)

    def on_pinned(self, pin: PinnedView) -> None:
        self._pinned = pin.view

    def on_phase(self, change: PhaseChange) -> None:
        self._phase = change.phase

    def on_output(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        self._output, self._arm, self._received_ns = output, arm, now_ns

    def on_stop(self, stop: StopRecord) -> None:
        self._last_stop = stop.reason

    def on_tick(self, tick: Tick) -> None:
        self._sample = tick.controller

    def on_allocation(self, allocation: Allocation) -> None:
        # in this thread: the control thread, too, asks for the state, and must not count packets
        self._figures = self._uplink.figures(allocation.t_ns)
        self._allocation = allocation

    def packets(self, packets: list[PacketRecord]) -> None:
        """Newly decided packet fates."""
        self._uplink.packets(packets)

    def on_uplink(self, reported: Sequence[PacketRecord], summary: UplinkSummary) -> None:
        self._uplink.report(reported)

    def state(
        self,
        now_ns: int,
        elapsed_s: float,
        video: ShownVideo,
        capacity: Capacity,
        given_fps: Mapping[str, float],
        hand: str,
        episodes: EpisodesState | None = None,
        latency: Mapping[str, LatencyState | None] = MappingProxyType({}),
    ) -> SessionState:
        """All that is known without the screen, from any thread; `hand`: of `HANDS`.

        `latency`: by view, what its frames take on this side.
        """
        figures, allocation, output, arm = self._figures, self._allocation, self._output, self._arm
        targets = {} if allocation is None else allocation.target_kbps
        primary = self._weights.primary_view(self._phase, self._pinned)
        ages = {view: video.age_ns(view, now_ns) for view in self._views}
        return SessionState(
            t_s=elapsed_s,
            arming=output.arming.value if output else "starting",
            reason=describe(output) if output else "",
            lasting=lasting_label(output) if output else "",
            last_stop=self._last_stop,
            deadman=output.deadman if output else False,
            orientation_mode=output.orientation_mode if output else False,
            gripper_closed=None if arm is None else arm.gripper_closed,
            hand=hand,
            pressed=() if self._sample is None else self._sample.pressed,
            phase=self._phase.value,
            primary_view=primary,
            is_pinned=primary == self._pinned,
            tcp_mm=None if arm is None else _mm(arm.tcp.position),
            views={
                view: ViewState(
                    target_kbps=targets.get(view),
                    sent_kbps=figures.sent_kbps[view],
                    given_fps=given_fps.get(view),
                    age_ms=None if (age := ages[view]) is None else age / NS_PER_MS,
                    own=latency.get(view),
                )
                for view in self._views
            },
            link_kbps=figures.link_kbps,
            budget_kbps=None if allocation is None else finite(allocation.budget_kbps),
            capacity_kbps=finite(capacity.mean_kbps(now_ns - WINDOW_NS, now_ns)),
            estimate_kbps=None if allocation is None else finite(allocation.capacity_kbps),
            queue_ms=figures.queue_ms,
            loss=figures.loss,
            asked_fps=self._asked_fps,
            now_ns=now_ns,
            heard_ns=self._received_ns,
            episodes=episodes,
            placed=self.placed,
            joints_urad=() if arm is None else _urad(arm.joints),
            joints_ns=0 if arm is None else arm.received_ns,
            speed_scale=output.speed_scale if output else 1.0,
            hottest_motor_c=None if arm is None else arm.hottest_motor_c,
        )


def _urad(joints: Vector) -> tuple[int, ...]:
    return tuple(np.rint(joints * 1e6).astype(int).tolist())


def _mm(position: Vector) -> tuple[float, float, float]:
    x, y, z = (position * 1000.0).tolist()
    return x, y, z
