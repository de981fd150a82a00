"""What the console shows of a running session, collected from the threads that know it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tams_app.capacity import Capacity
from tams_app.records import (
    Allocation,
    ArmState,
    ControllerSample,
    PacketRecord,
    Phase,
    PhaseChange,
    StopRecord,
    Tick,
    UplinkSummary,
    Vector,
)
from tams_app.session.control import ShownVideo, describe, lasting_label
from tams_app.session.listener import Listener
from tams_app.session.uplink_meter import WINDOW_NS, UplinkFigures, UplinkMeter
from tams_app.teleop.records import TeleopOutput
from tams_app.units import NS_PER_MS

GRIP_SHOWN_ABOVE = 0.5


@dataclass(frozen=True, slots=True)
class ViewStatus:
    """One view at this moment; None while nothing is known."""

    target_kbps: float | None
    sent_kbps: float | None
    shown_age_ms: float | None  # age of the frame on the screen, counted from its capture
    given_fps: float | None = None  # frames that came from the camera over the last second
    latency_ms: float | None = None  # of the newest frame, from its capture to the mailbox


@dataclass(frozen=True, slots=True)
class StatusSnapshot:
    """What the session knows at one moment.

    reason: why the arm does not move, "" if nothing holds it, as it is logged. lasting: label of
    what of it is still there; "": its cause is gone; None: not known. last_stop: label of the last
    stop of the recorded list, "" before the first. hand: what drives the arm, of `HANDS`.
    now_ns: the moment, on the session's clock. heard_ns: when what it says of the arm was true: of
    the control loop's last tick, or when the robot's side's last message came; None: not live.
    """

    t_s: float
    arming: str
    deadman: bool
    pressed: tuple[str, ...]  # buttons other than the trigger
    orientation_mode: bool
    phase: str
    reason: str
    lasting: str | None
    last_stop: str
    hand: str
    tcp_mm: tuple[float, float, float] | None  # in the arm's base frame
    gripper_closed: bool | None  # None: not known
    views: Mapping[str, ViewStatus]
    link_kbps: float | None
    capacity_kbps: float | None
    queue_ms: float | None
    asked_fps: float | None = None  # of each camera
    primary_view: str = ""
    live_ssim: float | None = None  # of the primary view, over its last scored frames
    budget_kbps: float | None = None
    estimate_kbps: float | None = None  # of the capacity, as the budget believes
    loss: float | None = None  # share of the packets of the last second
    now_ns: int = 0
    heard_ns: int | None = None


class StatusBoard(Listener):
    """Written by control, policy and relay threads, read by the console."""

    def __init__(self, views: tuple[str, ...]) -> None:
        self.phase = Phase.REACH
        self._allocation: Allocation | None = None
        self._views = views
        self._output: TeleopOutput | None = None
        self._arm: ArmState | None = None
        self._sample: ControllerSample | None = None
        self._heard_ns: int | None = None
        self._last_stop = ""
        self._uplink = UplinkMeter(views)
        self._notes: deque[str] = deque(maxlen=50)

    def on_phase(self, change: PhaseChange) -> None:
        self.phase = change.phase

    def on_output(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        self._output, self._arm, self._heard_ns = output, arm, now_ns

    def on_stop(self, stop: StopRecord) -> None:
        self._last_stop = stop.reason

    def on_tick(self, tick: Tick) -> None:
        self._sample = tick.controller

    def on_allocation(self, allocation: Allocation) -> None:
        self._allocation = allocation

    def packets(self, packets: list[PacketRecord]) -> None:
        """Newly decided packet fates."""
        self._uplink.packets(packets)

    def on_uplink(self, told: Sequence[PacketRecord], summary: UplinkSummary) -> None:
        self._uplink.told(told)

    def uplink(self, now_ns: int) -> UplinkFigures:
        """What the uplink carries; from any thread."""
        return self._uplink.figures(now_ns)

    def note(self, text: str) -> None:
        """A sentence that the console should print."""
        self._notes.append(text)

    def take_notes(self) -> list[str]:
        """Sentences not printed yet."""
        notes = []
        while self._notes:
            notes.append(self._notes.popleft())
        return notes

    def snapshot(
        self,
        now_ns: int,
        elapsed_s: float,
        video: ShownVideo,
        capacity: Capacity,
        given_fps: Mapping[str, float],
        hand: str,
    ) -> StatusSnapshot:
        """Everything at this moment; `hand`: what drives the arm, of `HANDS`."""
        uplink = self._uplink.figures(now_ns)
        targets = self._allocation.target_kbps if self._allocation else {}
        ages = {view: video.age_ns(view, now_ns) for view in self._views}
        output, arm = self._output, self._arm
        return StatusSnapshot(
            t_s=elapsed_s,
            arming=output.arming.value if output else "starting",
            deadman=output.deadman if output else False,
            pressed=pressed_buttons(self._sample),
            orientation_mode=output.orientation_mode if output else False,
            phase=self.phase.value,
            reason=describe(output) if output else "",
            lasting=lasting_label(output) if output else "",
            last_stop=self._last_stop,
            hand=hand,
            tcp_mm=None if arm is None else _mm(arm.tcp.position),
            gripper_closed=None if arm is None else arm.gripper_closed,
            views={
                view: ViewStatus(
                    target_kbps=targets.get(view),
                    sent_kbps=uplink.sent_kbps[view],
                    shown_age_ms=None if (age := ages[view]) is None else age / NS_PER_MS,
                    given_fps=given_fps.get(view),
                )
                for view in self._views
            },
            link_kbps=uplink.link_kbps,
            capacity_kbps=finite(capacity.mean_kbps(now_ns - WINDOW_NS, now_ns)),
            queue_ms=uplink.queue_ms,
            budget_kbps=self._allocation.budget_kbps if self._allocation else None,
            estimate_kbps=finite(self._allocation.capacity_kbps) if self._allocation else None,
            loss=uplink.loss,
            now_ns=now_ns,
            heard_ns=self._heard_ns,
        )


def pressed_buttons(sample: ControllerSample | None) -> tuple[str, ...]:
    """Names of the buttons that are down, other than the trigger."""
    if sample is None:
        return ()
    down = {
        "grip": sample.grip > GRIP_SHOWN_ABOVE,
        "A": sample.a,
        "B": sample.b,
        "menu": sample.menu,
    }
    return tuple(name for name, is_down in down.items() if is_down)


def _mm(position: Vector) -> tuple[float, float, float]:
    x, y, z = (position * 1000.0).tolist()
    return x, y, z


def finite(kbps: float) -> float | None:
    """A capacity; None where it is without limit."""
    return kbps if kbps != float("inf") else None
