"""The outbox that the control loop fills, and the one thread that talks to a moving Lite 6.

The loop leaves its newest command in the outbox and never waits; the thread hands it to the SDK,
waits for the reply, times it and reports in `link` what became of it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hw.lite6.commands import (
    GRIPPER_ATTEMPTS,
    NO_FAILURE,
    OUTPUTS_DIFFER,
    error_sentence,
    twist_refusal,
)
from hw.lite6.protocol import NOTHING_GETS_THROUGH, Code, return_code_sentence
from hw.lite6.sdk import break_off, set_cartesian_velocity
from tams_app.records import CommandLink, LinkFault, Twist
from tams_app.runtime.clock import Clock
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import times

GRIPPER_QUEUE = 4  # when full, the oldest command is dropped
KEEPALIVE_PERIOD_S = 0.25
MISSES_UNTIL_FAILURE = 2  # replies in a row; the controller's deadman runs out about then
READ_BACK_AFTER_NS = 50 * NS_PER_MS
READ_AGAIN_NS = NS_PER_S  # no report has the tool's outputs, which others may switch
_OUTPUTS_OPEN, _OUTPUTS_CLOSED = (1, 0), (0, 1)
_MM_PER_M = 1000.0


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


class CommandSender:
    """Sends what is in the outbox; the arm's `link` is what it saw.

    A failure shuts the outbox, so that nothing moves until the arm is enabled again. `on_error` is
    notified of the controller's error and warning codes as soon as a reply hints at them.

    A lost link is broken off as well. What was sent and not acknowledged still lies in the kernel,
    which would deliver it once the network is back, and the controller would drive it: after the
    fault, perhaps before the stop. One missed reply is not enough for that. The kernel repeats a
    command after 200 ms at the earliest, so that two reply time-outs come first; if it gets through
    before, the newer command behind it replaces it at once. But if the arm was stopped meanwhile,
    no newer one follows, and one missed reply breaks off.
    """

    def __init__(
        self,
        api: Any,
        outbox: Outbox,
        clock: Clock,
        deadman_s: float,
        slow_after_ns: int,
        on_error: Callable[[int, int], None],
    ) -> None:
        self._api, self._outbox, self._clock = api, outbox, clock
        self._deadman_s = deadman_s
        self._slow_after_ns = slow_after_ns
        self._on_error = on_error
        self._misses = 0
        self._read_back: bool | None = None  # a gripper command whose effect is still to be read
        self._attempts_left = 0
        self._worker = Worker("arm-sender", self._run, self._on_death)
        self._sent = 0
        self._slow = 0
        self._acknowledged_ns = clock.now_ns()
        self._round_trip_ns = 0
        self._failure: tuple[str, LinkFault] = NO_FAILURE
        self._death = ""  # of the thread, which nothing but a new connection brings back
        self._doubts = 0
        self._gripper: tuple[bool | None, int] = (None, 0)  # what it does, after so many doubts
        self._gripper_due_ns = 0  # to be read again
        self.native_id: int | None = None

    def start(self) -> None:
        """Read the gripper back, then send."""
        self._check_gripper(opening=0)
        self._worker.start()

    @property
    def gripper_closed(self) -> bool | None:
        """What the tool's outputs drive it to; None: nothing, or it is not known any more."""
        closed, doubts = self._gripper
        return closed if doubts == self._doubts else None

    def doubt_gripper(self) -> None:
        """Something happened that may have switched its outputs: it is not known until read."""
        self._doubts += 1
        self._gripper_due_ns = 0

    def open(self) -> None:
        """Begin anew without failure."""
        self.forget_failure()
        self._read_back = None
        self._outbox.open()

    def forget_failure(self) -> None:
        """The operator has dealt with it; the end of the thread stays a failure."""
        self._misses = 0
        self._failure = NO_FAILURE
        self._gripper_due_ns = 0  # in an error it cannot be read

    @property
    def link(self) -> CommandLink:
        """Its `failure` says why commands no longer get through; "" if they do."""
        failure, fault = (self._death, LinkFault.LOST) if self._death else self._failure
        return CommandLink(
            self._sent, self._acknowledged_ns, self._round_trip_ns, self._slow, failure, fault
        )

    def close(self) -> None:
        """End the thread; may be called twice."""
        self._worker.request_stop()
        self._outbox.shut()
        self._worker.stop()

    def _run(self, stop: threading.Event) -> None:
        self.native_id = threading.get_native_id()
        while not stop.is_set():
            work = self._outbox.take(KEEPALIVE_PERIOD_S)
            if stop.is_set():
                return
            if work.motion is not None:
                self._send_motion(work.opening, work.motion)
            if work.gripper_closed is not None:
                self._send_gripper(work.opening, work.gripper_closed)
            if work.motion is None and work.gripper_closed is None:
                self._outcome(work.opening, "a keep-alive", self._timed(self._ask_state))
            self._check_gripper(work.opening)

    # --- motion ---------------------------------------------------------------------------------

    def _send_motion(self, opening: int, motion: Twist) -> None:
        if refusal := twist_refusal(motion):
            self._fail(opening, refusal, LinkFault.REFUSED)
            return
        if not self._outbox.is_current(opening):
            return
        self._sent += 1
        speeds = [*times(motion.linear, _MM_PER_M), *motion.angular]
        code = self._timed(set_cartesian_velocity, self._api, speeds, self._deadman_s)
        self._moved(opening, "a motion command", code)

    # --- gripper --------------------------------------------------------------------------------

    def _send_gripper(self, opening: int, closed: bool) -> None:
        # firmware that knows the switch would otherwise queue the outputs behind motion
        sync = self._api.version_number < (2, 4, 101)
        call = self._api.close_lite6_gripper if closed else self._api.open_lite6_gripper
        doubts = self._doubts
        for _ in range(GRIPPER_ATTEMPTS):
            if not self._outbox.is_current(opening):  # stopped, or the last attempt was a failure
                return
            self._sent += 1
            code = self._timed(call, sync)
            if code == Code.ERROR or code in NOTHING_GETS_THROUGH:
                self._moved(opening, "a gripper command", code)
            elif code in (Code.OK, Code.WARNING):
                self._misses = 0
                self._gripper = closed, doubts
                self._read_back, self._attempts_left = closed, GRIPPER_ATTEMPTS
                self._gripper_due_ns = self._clock.now_ns() + READ_BACK_AFTER_NS
                return
        sentence = return_code_sentence(code, "a gripper command")
        self._fail(opening, sentence, LinkFault.GRIPPER)

    def _check_gripper(self, opening: int) -> None:
        """Read the tool outputs when that is due, and compare them with the last command."""
        if self._clock.now_ns() < self._gripper_due_ns or self._misses:
            return  # not due, or nothing may get through: motion shows that sooner
        doubts, read_back = self._doubts, self._read_back
        code, driven = self._read_gripper()
        is_read = code in (Code.OK, Code.WARNING)
        if code in NOTHING_GETS_THROUGH:
            self._outcome(opening, "a look at the gripper", code)
        self._gripper_due_ns = self._clock.now_ns() + READ_AGAIN_NS
        differs = read_back is not None and driven is not read_back
        self._attempts_left -= 1
        if differs and self._attempts_left > 0:
            self._gripper_due_ns = self._clock.now_ns() + READ_BACK_AFTER_NS
            return
        self._read_back = None
        if is_read or differs:
            self._gripper = driven, doubts
        if differs:
            self._fail(opening, OUTPUTS_DIFFER, LinkFault.GRIPPER)

    def _read_gripper(self) -> tuple[int, bool | None]:
        """The return code and the command on the tool outputs; None: they are off, or not read."""
        try:
            code, outputs = self._api.get_tgpio_output_digital()
        except ValueError:  # so the SDK fails if the connection breaks during this call
            return Code.INVALID, None
        if code not in (Code.OK, Code.WARNING):
            return int(code), None
        return int(code), {_OUTPUTS_OPEN: False, _OUTPUTS_CLOSED: True}.get(tuple(outputs[:2]))

    # --- what became of it ----------------------------------------------------------------------

    def _timed(self, send: Callable[..., int], *arguments: object) -> int:
        """Do one call; its return code. The time it took is noted if it was acknowledged."""
        started_ns = self._clock.now_ns()
        code = int(send(*arguments))
        now_ns = self._clock.now_ns()
        if code in (Code.OK, Code.WARNING):
            self._acknowledged_ns = now_ns
            self._round_trip_ns = now_ns - started_ns
            self._slow += self._round_trip_ns > self._slow_after_ns
        elif code == Code.TIMEOUT:
            self._slow += 1
        return code

    def _moved(self, opening: int, what: str, code: int) -> None:
        """As `_outcome`, of a command that moves something, and must not arrive after a stop."""
        if code == Code.TIMEOUT and not self._outbox.is_current(opening):
            self._lose(return_code_sentence(code, what))
        else:
            self._outcome(opening, what, code)

    def _outcome(self, opening: int, what: str, code: int) -> None:
        """Take note of what `code` says of the link."""
        if code in (Code.OK, Code.WARNING):
            self._misses = 0
            return
        if code == Code.TIMEOUT:
            self._misses += 1
            if self._misses < MISSES_UNTIL_FAILURE:
                return
        sentence = return_code_sentence(code, what)
        if code == Code.ERROR:
            sentence = self._ask_for_error() or sentence
        if code not in NOTHING_GETS_THROUGH:
            self._fail(opening, sentence, LinkFault.REFUSED)
        elif self._outbox.is_current(opening):
            self._lose(sentence)

    def _ask_state(self) -> int:
        return int(self._api.get_state()[0])

    def _ask_for_error(self) -> str:
        """The report brings an error up to 200 ms later: ask at once."""
        code, codes = self._api.get_err_warn_code()
        if code != Code.OK or not codes[0]:
            return ""
        self._on_error(codes[0], codes[1])
        return error_sentence(codes[0])

    def _fail(self, opening: int, sentence: str, fault: LinkFault) -> None:
        """Keep the first failure; a reply to something older than the last stop is none."""
        if self._outbox.is_current(opening) and self._failure is NO_FAILURE:
            self._failure = (sentence, fault)
            self._outbox.shut()

    def _lose(self, sentence: str) -> None:
        """Nothing gets through: nothing may get through later either.

        Notified last: when the control loop stops the arm for it, what was sent is taken back
        already.
        """
        self._outbox.shut()
        self.doubt_gripper()
        try:
            break_off(self._api)
        finally:  # the loop is notified however this ends
            if self._failure is NO_FAILURE:
                self._failure = (sentence, LinkFault.LOST)

    def _on_death(self, name: str, failure: BaseException) -> None:
        self._death = f"The thread {name} ended ({failure}); please report this error."
        self._outbox.shut()
