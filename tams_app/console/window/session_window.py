"""The window of a session: what it is told of the session, and what its keys do there."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from hw.desk.keyboard import DEADMAN, KEYS, HeldKeys, KeyboardController
from tams_app.config import Config
from tams_app.console.window.client import WindowClient
from tams_app.console.window.messages import (
    Asked,
    Event,
    Facts,
    Keys,
    Said,
    TrialFacts,
    ViewFacts,
    Wish,
)
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.worker import Worker
from tams_app.session.status import StatusSnapshot, ViewStatus
from tams_app.teleop.advice import what_to_do
from tams_app.units import NS_PER_S
from tams_app.video.frame_ring import FrameBlock

EVERY_NS = NS_PER_S // 10  # facts for the window
SILENT_NS = 2 * NS_PER_S  # of a window that tells of itself 20 times a second
OPENING_NS = 10 * NS_PER_S  # until it tells the first time
_HAND_KEYS = {"Shift_L": DEADMAN, "Shift_R": DEADMAN}
_SAID, _LONGEST_SENTENCE = 3, 500


class Signals(Protocol):
    """What the operator asks for by key."""

    def confirm(self) -> None: ...

    def estop(self) -> None: ...


class WindowedSession(Protocol):
    """What the window needs of a session."""

    config: Config
    folder: Path
    screen: FrameBlock
    keyboard: KeyboardController | None

    @property
    def signals(self) -> Signals: ...

    def end(self, reason: str) -> None: ...

    def fail(self, sentence: str) -> None: ...

    def note(self, level: str, text: str) -> None: ...

    def elapsed_s(self) -> float: ...

    def snapshot(self) -> StatusSnapshot: ...


TrialOf = Callable[[StatusSnapshot], TrialFacts]


class SessionWindow:
    """Launched and opened, it follows the session until it is closed; `refresh` it often."""

    def __init__(
        self,
        session: WindowedSession,
        trial_of: TrialOf | None = None,
        replay_keys: Callable[[Keys], None] | None = None,
    ) -> None:
        """`trial_of`: the trial as it stands, where nothing else may be told of the session.

        `replay_keys`: the session is a replay, and this hears of all keys that are down, in a
        thread of the window's.
        """
        self._session, self._replay_keys = session, replay_keys
        self._trial_of = trial_of
        self._clock = MonotonicClock()
        self._client = WindowClient(self._clock)
        self._said: deque[Said] = deque(maxlen=_SAID)
        self._stack = ExitStack()
        self._next_ns = 0
        self._opened_ns = 0
        self._silent = False
        self._gone = False

    def launch(self) -> None:
        """Start its process, before the session has the processor; SetupError without a display."""
        logs = self._session.folder / "helpers"
        logs.mkdir(exist_ok=True)
        self._client.launch(logs)
        self._stack.callback(self._client.close)

    def open(self) -> None:
        """Show it, once the session has started."""
        session = self._session
        blind, replay = self._trial_of is not None, self._replay_keys is not None
        self._client.open(session.config, session.screen, blind, replay)
        self._opened_ns = self._clock.now_ns()
        worker = Worker("window", self._client.body(self._on_event), self._on_failure)
        self._stack.callback(worker.stop)
        worker.start()

    @property
    def pid(self) -> int | None:
        """Of its process."""
        return self._client.pid

    def say(self, text: str) -> None:
        """A sentence for the operator."""
        self._said.append(Said(self._session.elapsed_s(), text[:_LONGEST_SENTENCE]))

    def refresh(self) -> None:
        """Tell it what is new, if it is time to, and look after it."""
        if self._client.ended and not self._gone:
            self._gone = True
            self._session.fail("the window's process ended unasked, so the operator sees nothing")
        self._watch_silence()
        now_ns = self._clock.now_ns()
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + EVERY_NS
            self._client.show(self._facts(self._session.snapshot()))

    def close(self) -> None:
        """Close it; may be called twice."""
        self._stack.close()

    def _watch_silence(self) -> None:
        """A window that stands still shows old frames, by which the operator must not steer."""
        heard_ns = self._client.heard_ns
        since_ns, patience_ns = (
            (self._opened_ns, OPENING_NS) if heard_ns is None else (heard_ns, SILENT_NS)
        )
        silent = self._clock.now_ns() - since_ns > patience_ns
        if silent and not self._silent:
            if not self._session.config.operator_is_simulated:
                self._session.signals.estop()
            self._session.note(
                "warning", "the window does not answer, its pictures may be old: do not steer by it"
            )
        self._silent = silent

    def _facts(self, snapshot: StatusSnapshot) -> Facts:
        trial = None if self._trial_of is None else self._trial_of(snapshot)
        return facts_of(snapshot, tuple(self._said), trial)

    def _on_event(self, event: Event) -> None:
        if not isinstance(event, Asked):
            if self._replay_keys is not None:
                self._replay_keys(event)
            if self._session.keyboard is not None:
                self._session.keyboard.feed(held_keys(event))
            return
        actions: dict[Wish, Callable[[], None]] = {
            Wish.CONFIRM: self._session.signals.confirm,
            Wish.EMERGENCY_STOP: self._session.signals.estop,
            Wish.QUIT: lambda: self._session.end("ended by the operator"),
            Wish.CLOSE: lambda: self._session.end("the operator closed the window"),
        }
        actions[event.wish]()

    def _on_failure(self, name: str, failure: BaseException) -> None:
        self._session.fail(f"{name}: {failure!r}")


def held_keys(event: Keys) -> HeldKeys:
    """The keys that are down, for a hand that they move."""
    names = {_HAND_KEYS.get(name, name) for name in event.held}
    return HeldKeys(KEYS & names, event.focused, event.t_ns)


def facts_of(
    snapshot: StatusSnapshot, said: tuple[Said, ...], trial: TrialFacts | None = None
) -> Facts:
    """The snapshot as the window gets it; in a trial without all that tells what is compared."""
    blind = trial is not None
    return Facts(
        t_s=snapshot.t_s,
        arming=snapshot.arming,
        reason=snapshot.reason,
        advice=what_to_do(snapshot.reason),
        deadman=snapshot.deadman,
        pressed=snapshot.pressed,
        orientation_mode=snapshot.orientation_mode,
        gripper_closed=snapshot.gripper_closed,
        phase=snapshot.phase,
        primary_view=snapshot.primary_view,
        tcp_mm=snapshot.tcp_mm,
        views={
            name: ViewFacts(None, None, None, None, None) if blind else _view(view)
            for name, view in snapshot.views.items()
        },
        link_kbps=None if blind else snapshot.link_kbps,
        budget_kbps=None if blind else snapshot.budget_kbps,
        capacity_kbps=None if blind else snapshot.estimate_kbps,
        queue_ms=None if blind else snapshot.queue_ms,
        loss=None if blind else snapshot.loss,
        asked_fps=None if blind else snapshot.asked_fps,
        trial=trial,
        said=said,
    )


def _view(view: ViewStatus) -> ViewFacts:
    return ViewFacts(
        target_kbps=view.target_kbps,
        sent_kbps=view.sent_kbps,
        given_fps=view.given_fps,
        latency_ms=view.latency_ms,
        age_ms=view.shown_age_ms,
    )
