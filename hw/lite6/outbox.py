"""The outbox to the arm's wire: the control loop puts, the sender thread takes."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

from tams_app.records import Twist

GRIPPER_QUEUE = 4  # when full, the oldest command is dropped


@dataclass(frozen=True, slots=True)
class Work:
    """The next thing to send, and the opening of the outbox that it was left for."""

    opening: int
    motion: Twist | None
    gripper_closed: bool | None


class Outbox:
    """The newest motion command and a few gripper commands; shut unless the servo is enabled."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self.is_open = False
        self._opening = 0
        self._motion: Twist | None = None
        self._gripper: deque[bool] = deque(maxlen=GRIPPER_QUEUE)

    def open(self) -> None:
        """Take commands from now on."""
        with self._news:
            self.is_open = True
            self._opening += 1

    def shut(self) -> None:
        """Forget what waits and take nothing until opened."""
        with self._news:
            self.is_open = False
            self._opening += 1
            self._motion = None
            self._gripper.clear()
            self._news.notify()

    def is_current(self, opening: int) -> bool:
        """True if the outbox was neither shut nor opened anew since `opening`."""
        return opening == self._opening

    def put_motion(self, motion: Twist) -> None:
        with self._news:
            if self.is_open:
                self._motion = motion
                self._news.notify()

    def put_gripper(self, closed: bool) -> None:
        with self._news:
            if self.is_open:
                self._gripper.append(closed)
                self._news.notify()

    def take(self, timeout_s: float) -> Work:
        """The newest motion and the oldest gripper command; neither after `timeout_s` or a shut."""
        with self._news:
            if self._motion is None and not self._gripper:
                self._news.wait(timeout_s)
            motion, self._motion = self._motion, None
            gripper = self._gripper.popleft() if self._gripper else None
            return Work(self._opening, motion, gripper)
