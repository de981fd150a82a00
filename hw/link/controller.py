"""A controller whose samples come over the link; missing ones are a status, as with any other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from hw.controller import Controller
from tams_app.config import LinkConfig
from tams_app.link.age import LeastOffset, age_bound_ns
from tams_app.link.messages import HandMessage
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS

_STATUSES = {status.value: status for status in ControllerStatus}
_LOST = ControllerSample(
    ControllerStatus.LINK_LOST, None, 0, 0, trigger=0.0, grip=0.0, a=False, b=False, menu=False
)


class LinkController(Controller):
    """The newest sample that may move the arm; `take` and `sample` are for the control thread.

    A sample counts if it cannot be older than `LinkConfig.longest_age_ms`, judged by the echo of
    our own stamp in it (`age_bound_ns`): what was queued during an outage is counted and left out.
    Its times become ours by the shortest way that a message has taken lately, so that a pose of a
    steady hand comes at a steady rate, and what is queued makes it older.
    """

    def __init__(
        self,
        config: LinkConfig,
        receive: Callable[[int], None],
        pulse: Callable[[Haptic], None],
    ) -> None:
        """`receive` is called at the start of each `sample`, to `take` what has come."""
        self.refused: Counter[str] = Counter()  # samples that did not count, by reason
        self._longest_ns = config.longest_age_ms * NS_PER_MS
        self._lost_after_ns = config.lost_after_ms * NS_PER_MS
        self._receive = receive
        self._pulse = pulse
        self._heard_ns: int | None = None
        self._newest_sent_ns = 0
        self._offset = LeastOffset()
        self._sample = _LOST
        self._started = False

    def start(self) -> None:
        self._started = True

    def sample(self, now_ns: int) -> ControllerSample:
        self._receive(now_ns)
        heard_ns = self._heard_ns
        if not self._started or heard_ns is None or now_ns - heard_ns > self._lost_after_ns:
            self.let_go()
            return _LOST
        return self._sample

    def pulse(self, haptic: Haptic) -> None:
        self._pulse(haptic)

    def close(self) -> None:
        self._started = False

    def take(self, message: HandMessage, heard_ns: int) -> str:
        """Take a sample that was heard at `heard_ns`; "" if it counts, else why it does not."""
        refusal = self._refusal(message, heard_ns)
        if refusal:
            self.refused[refusal] += 1
            return refusal
        self._newest_sent_ns = message.sent_ns
        offset_ns = self._offset.step(heard_ns, heard_ns - message.sent_ns)
        self._heard_ns = heard_ns
        self._sample = ControllerSample(
            _STATUSES[message.status],
            _pose(message),
            min(message.pose_ns + offset_ns, heard_ns),
            min(message.buttons_ns + offset_ns, heard_ns),
            trigger=message.trigger,
            grip=message.grip,
            a=message.a,
            b=message.b,
            menu=message.menu,
        )
        return ""

    def let_go(self) -> None:
        """Forget the operator: what comes next is judged as if it were the first."""
        self._heard_ns = None
        self._newest_sent_ns = 0
        self._offset = LeastOffset()

    def _refusal(self, message: HandMessage, heard_ns: int) -> str:
        bound_ns = age_bound_ns(heard_ns, message.echo_ns)
        if bound_ns is None:
            return "without an echo"
        if bound_ns > self._longest_ns:
            return "too old"
        if message.sent_ns <= self._newest_sent_ns:
            return "overtaken"
        if message.status not in _STATUSES:
            return "of unknown status"
        return ""


def _pose(message: HandMessage) -> Pose | None:
    if message.pose is None:
        return None
    return Pose(np.array(message.pose[:3]), Rotation(*message.pose[3:]))
