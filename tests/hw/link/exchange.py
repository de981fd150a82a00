"""The operator's side and the network in this process: samples out, stamps back, virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hw.link.controller import LinkController
from tams_app.config import LinkConfig
from tams_app.link.messages import HandMessage
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS, NS_PER_S

TICK_NS = 8_333_333
HOUR_NS = 3600 * NS_PER_S


def hand_message(
    sample: ControllerSample, sent_ns: int, echo_ns: int, echo_heard_ns: int = 0
) -> HandMessage:
    """What the operator's side sends of a sample; every time but the echo is on its clock."""
    pose, presses = None, sample.presses
    if sample.pose is not None:
        x, y, z = sample.pose.position.tolist()
        pose = (x, y, z, *sample.pose.rotation)
    return HandMessage(
        operator=4711,
        simulated=False,
        sent_ns=sent_ns,
        echo_ns=echo_ns,
        echo_heard_ns=echo_heard_ns,
        status=sample.status.value,
        pose=pose,
        pose_ns=sample.pose_ns,
        buttons_ns=sample.buttons_ns,
        trigger=sample.trigger,
        grip=sample.grip,
        a=sample.a,
        b=sample.b,
        menu=sample.menu,
        shown=(),
        presses=(presses.grip, presses.a, presses.b, presses.menu),
    )


@dataclass
class FarHand:
    """A hand at the other computer; `read` is what its controller says at a time of its clock."""

    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    position: np.ndarray = field(default_factory=lambda: np.array([0.0, 1.0, -0.3]))
    trigger: float = 0.0
    frozen: bool = False
    buttons_frozen: bool = False
    tracked: bool = True
    status: ControllerStatus = ControllerStatus.OK
    pose_age_ns: int = 0
    _pose_ns: int = 0
    _buttons_ns: int = 0

    def read(self, now_ns: int, interval_s: float) -> ControllerSample:
        if self.tracked and not self.frozen:
            self.position = self.position + self.velocity * interval_s
            self._pose_ns = now_ns - self.pose_age_ns
        if not self.buttons_frozen:
            self._buttons_ns = now_ns
        position = self.position - self.velocity * (self.pose_age_ns / NS_PER_S)
        return ControllerSample.released(
            self.status,
            Pose(position, Rotation.identity()) if self.tracked else None,
            self._pose_ns,
            self._buttons_ns,
            trigger=self.trigger,
        )


class Exchange:
    """A `LinkController` and what feeds it: each tick a sample leaves, and a stamp of ours.

    delay_ms: of both ways. offset_ns: the operator's clock minus ours, which may change at any
    time. up: what becomes of a message of the operator: its delay [ns], or None if it is lost.
    down: the same of our stamps.
    """

    def __init__(
        self,
        config: LinkConfig | None = None,
        delay_ms: float = 20.0,
        offset_ns: int = -7 * HOUR_NS,
        now_ns: int = 100 * HOUR_NS,
    ) -> None:
        self.config = config or LinkConfig()
        self.hand = FarHand()
        self.now_ns = now_ns
        self.offset_ns = offset_ns
        delay_ns = round(delay_ms * NS_PER_MS)
        self.up: Callable[[int], int | None] = lambda _now_ns: delay_ns
        self.down: Callable[[int], int | None] = lambda _now_ns: delay_ns
        self.pulses: list[Haptic] = []
        self.controller = LinkController(self.config, self._deliver, self.pulses.append)
        self.controller.start()
        self.on_their_way: list[tuple[int, HandMessage]] = []
        self.sent: list[HandMessage] = []
        self.taken: list[str] = []  # why each one that arrived did not count
        self._stamps: list[tuple[int, int]] = []  # on their way: received there, stamp
        self._echo = (0, 0)  # the newest stamp there, and when it was received by its clock

    def tick(self, interval_ns: int = TICK_NS) -> ControllerSample:
        """One control period at both sides; the sample at its end."""
        self.now_ns += interval_ns
        self._send(interval_ns / NS_PER_S)
        return self.controller.sample(self.now_ns)

    def run_ms(self, duration_ms: float) -> list[ControllerSample]:
        """Samples of so many milliseconds."""
        return [self.tick() for _ in range(round(duration_ms * NS_PER_MS / TICK_NS))]

    def settled(self) -> Exchange:
        """After half a second."""
        sample = self.run_ms(500)[-1]
        assert sample.status is ControllerStatus.OK
        return self

    def take(self, message: HandMessage) -> str:
        """A message arrives now."""
        return self.controller.take(message, self.now_ns)

    def message(self, **changes: object) -> HandMessage:
        """What the operator's side would send now."""
        there_ns = self.now_ns + self.offset_ns
        made = hand_message(self.hand.read(there_ns, 0.0), there_ns, *self._newest_echo())
        fields = {"pose_ns": there_ns}
        values = {name: getattr(made, name) for name in HandMessage.__struct_fields__}
        return HandMessage(**{**values, **fields, **changes})

    def _newest_echo(self) -> tuple[int, int]:
        received = [one for one in self._stamps if one[0] <= self.now_ns]
        self._stamps = [one for one in self._stamps if one[0] > self.now_ns]
        for received_ns, stamp_ns in sorted(received):
            if stamp_ns > self._echo[0]:
                self._echo = stamp_ns, received_ns + self.offset_ns
        return self._echo

    def _send(self, interval_s: float) -> None:
        now_ns = self.now_ns
        there_ns = now_ns + self.offset_ns
        down_ns, up_ns = self.down(now_ns), self.up(now_ns)
        if down_ns is not None:
            self._stamps.append((now_ns + down_ns, now_ns))
        sample = self.hand.read(there_ns, interval_s)
        message = hand_message(sample, there_ns, *self._newest_echo())
        self.sent.append(message)
        if up_ns is not None:
            self.on_their_way.append((now_ns + up_ns, message))

    def _deliver(self, now_ns: int) -> None:
        here = [one for one in self.on_their_way if one[0] <= now_ns]
        self.on_their_way = [one for one in self.on_their_way if one[0] > now_ns]
        for heard_ns, message in sorted(here, key=lambda one: one[0]):
            self.taken.append(self.controller.take(message, heard_ns))


def queued(start_ns: int, end_ns: int, delay_ns: int) -> Callable[[int], int]:
    """A way on which all that is sent from start to end arrives at the end, in a burst."""

    def delay(now_ns: int) -> int:
        held_ns = end_ns - now_ns if start_ns <= now_ns < end_ns else 0
        return max(delay_ns, held_ns)

    return delay
