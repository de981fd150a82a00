"""The trial on the simulated rig: reads where things are, asks the judge."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tams_app.records import SceneTruth
from tams_app.runtime.clock import Clock, FixedRate
from tams_app.study.trial import TrialJudge

RATE_HZ = 30.0


class TrialLoop:
    """Steps the judge 30 times a second until the trial has ended; the body of a Worker."""

    def __init__(
        self,
        clock: Clock,
        judge: TrialJudge,
        truth: Callable[[], SceneTruth | None],
        gripper_closed: Callable[[], bool | None],
        record: Callable[[SceneTruth], None],
        ended: Callable[[], None],
    ) -> None:
        self._clock = clock
        self._judge = judge
        self._truth = truth
        self._gripper_closed = gripper_closed
        self._record = record
        self._ended = ended

    def run(self, stop: threading.Event) -> None:
        rate = FixedRate(self._clock, RATE_HZ)
        while not stop.is_set():
            rate.wait()
            if self.look():
                return

    def look(self) -> bool:
        """Record where things are and ask the judge; True once the trial has ended."""
        scene = self._truth()
        if scene is None:
            return False
        self._record(scene)
        if not self._judge.step(self._clock.now_ns(), scene, self._gripper_closed()):
            return False
        self._ended()
        return True
