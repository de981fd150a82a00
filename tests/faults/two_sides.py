"""A session on two computers for faults: the robot's side as a process, and a hand at the other."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import psutil

from hw.controller import Controller
from tams_app.config import Config, load_config
from tams_app.link.gateway_client import Endpoint
from tams_app.link.messages import StateMessage
from tams_app.recording import SessionLog
from tams_app.records import Image, ShownFrame
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.operate import operate
from tams_app.session.session import Outset, Session
from tams_app.station.linked_robot import Requests
from tams_app.station.operator_side import OperatorSide
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.applications import PATIENCE_S, Application, only_log, until
from tests.faults.hand import Hand
from tests.free_port import free_port

HOST = "127.0.0.1"
FULL_SPEED_M_S = 0.3  # of the hand: more than the arm's, which is then at its limit
# What a wireless link carries. Without a limit the estimate finds none on loopback: 20 Mbit/s of
# video keep both processors of a small machine busy with encoding and encrypting, frames leave
# 200 ms late, and the jitter buffer gives up every gap in them at once, even one of datagrams that
# are only out of order.
VIDEO_KBPS = 3000.0
_CONFIRM_EACH_S = 1.0
_PRESSED_S = 1.0
_UNHINDERED_S = 1.0  # five frames: the first after an outage may be damaged, and use up a press
_RELEASED_S = 0.2  # what was pressed must be seen released before it counts again
_WAY_TO_SPEED_MM = 60.0
_WAY_S = 2.0


class RobotSide(Application):
    """`run_tams.py robot` on the rig in a process of its own; ends it when left."""

    def __init__(
        self,
        out: Path,
        key: Path | None = None,
        **overrides: object,
    ) -> None:
        self.port = free_port(socket.SOCK_DGRAM)
        words = ["robot", "--sim", "--listen", f"{HOST}:{self.port}"]
        words += [] if key is None else ["--key", str(key)]
        settings: dict[str, object] = {
            "network": "none",
            "policy": {"budget": {"mode": "feedback", "max_kbps": VIDEO_KBPS}},
            **overrides,
        }
        out.mkdir(exist_ok=True)
        super().__init__(out, words=words, **settings)

    def waits(self) -> None:
        """Until an operator may call."""
        self.says("waiting for an operator")
        until(self._is_started, "the robot's side to have started")
        self.note_helpers()

    def recorded(self) -> SessionLog:
        """Its log, once it has ended."""
        return only_log(self.out)

    def _is_started(self) -> bool:
        return any("DISARMED" in line and Reason.NO_OPERATOR.label in line for line in self.lines)


class OperateSide(Application):
    """`run_tams.py operate` with the simulated operator, in a process of its own."""

    def __init__(self, out: Path, port: int) -> None:
        words = ["operate", "--sim", "--robot", f"{HOST}:{port}"]
        out.mkdir(exist_ok=True)
        super().__init__(out, operator="seeing", words=words)


class HandSide:
    """The operator's side in this process, with `hand` in place of the operator; a context."""

    def __init__(
        self,
        out: Path,
        port: int,
        key: Path | None = None,
        seconds: float | None = None,
        headless: bool = True,
    ) -> None:
        """`port`: where it calls, on loopback. `seconds`: after which it ends."""
        out.mkdir()
        self._hand: Hand | None = None
        self._notes: list[str] = []
        self.said: list[str] = []
        config = load_config(
            overrides={
                "rig.enabled": True,
                "headless": headless,
                "seconds": seconds,
                "view.predict": "off",
                "recording.directory": str(out),
                "recording.min_free_mb": 1.0,
            }
        )
        folder = out / "session"
        folder.mkdir()
        endpoint = Endpoint(HOST, port, key)
        self.outset = Outset(config, MonotonicClock(), folder, Requests())
        self._endpoint = endpoint
        self._session: Session | None = None  # while it starts
        self._stack = ExitStack()

    @contextmanager
    def opening(self) -> Iterator[Session]:
        """The session while it is open."""
        with operate(self.outset, self._endpoint, self.said.append, self._take_hand) as session:
            self._session = session
            yield session

    def __enter__(self) -> HandSide:
        self._stack.enter_context(self.opening())
        until(lambda: self.state is not None, "the robot's state")
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    @property
    def session(self) -> Session:
        """Open."""
        assert self._session is not None, "not before the start"
        return self._session

    @property
    def hand(self) -> Hand:
        """What the operator holds."""
        assert self._hand is not None, "not before the start"
        return self._hand

    @property
    def state(self) -> StateMessage | None:
        """What the robot's side told last; None before it has."""
        if self._session is None:
            return None
        assert isinstance(self._session.side, OperatorSide)
        return self._session.side.link.state

    def received(self, view: str) -> Image | None:
        """The newest frame of that view; None before the first."""
        shown = self.shown(view)
        return None if shown is None else shown.image

    def shown(self, view: str) -> ShownFrame | None:
        """The same with its times."""
        assert isinstance(self.session.side, OperatorSide)
        return self.session.side._receivers.shown(view)

    @property
    def arming(self) -> str:
        """As the robot's side told last, "" before it did."""
        return "" if self.state is None else self.state.state.arming

    @property
    def reason(self) -> str:
        """Why the arm does not move, as the robot's side told last."""
        return "" if self.state is None else self.state.state.reason

    @property
    def notes(self) -> list[str]:
        """Sentences for the operator so far."""
        self._notes += self.outset.sentences.take()
        return self._notes

    def becomes(self, arming: ArmingState, within_s: float = 60.0) -> None:
        """Wait until the robot's side tells so."""
        until(lambda: self.arming == arming, f"{arming}, not {self.arming}", within_s)

    def engages(self) -> None:
        """Arm, whatever has stopped the arm before, and press the trigger; the hand rests."""
        self.hand.velocity = np.zeros(3)
        self.arms()
        self.hand.trigger = 1.0
        _waits(lambda: self.arming == ArmingState.ENGAGED, _PRESSED_S)
        time.sleep(0.1)
        assert self.arming == ArmingState.ENGAGED, f"{self.arming}: {self.reason}"

    def arms(self) -> None:
        """Let go and arm, whatever has stopped the arm before; it waits, ready."""
        self.hand.trigger = 0.0
        time.sleep(_RELEASED_S)
        asked_s = 0.0
        now_s = hindered_s = time.monotonic()
        deadline_s = now_s + PATIENCE_S
        while now_s - hindered_s < _UNHINDERED_S:  # the first video may come after READY
            self.session.poll()
            assert not self.outset.failure, self.outset.failure
            assert now_s < deadline_s, f"{self.arming}: {self.reason}"
            armed = self.arming == ArmingState.READY
            if not armed and now_s - asked_s > _CONFIRM_EACH_S:
                asked_s = now_s
                self.session.signals.confirm(time.monotonic_ns())
            time.sleep(0.02)
            now_s = time.monotonic()
            if not armed or self.reason:
                hindered_s = now_s

    def moves(self) -> None:
        """Engage, and go at full speed towards the other side until the arm is under way."""
        self.engages()
        y_mm = self._y_mm()
        self.hand.velocity = np.array([0.0, -np.sign(y_mm) or 1.0, 0.0]) * FULL_SPEED_M_S
        _waits(
            lambda: (
                abs(self._y_mm() - y_mm) > _WAY_TO_SPEED_MM or self.arming != ArmingState.ENGAGED
            ),
            _WAY_S,
        )
        assert abs(self._y_mm() - y_mm) > _WAY_TO_SPEED_MM, f"{self.arming}: {self.reason}"

    def loses_the_link(
        self, cut: Callable[[], int], restore: Callable[[], object], seconds: float
    ) -> int:
        """Cut the link for so long while the arm moves; what `cut` returned: when it was [ns]."""
        self.moves()
        cut_ns = cut()
        time.sleep(seconds)
        restore()
        self.becomes(ArmingState.HOLDING)  # for the gap, and then perhaps for the video
        return cut_ns

    def helper(self, name: str) -> psutil.Process:
        """The helper process of that name."""
        return psutil.Process(self.session._parts.pids[name])

    def _take_hand(self, config: Config) -> Controller:
        self._hand = Hand(config)
        return self._hand

    def _y_mm(self) -> float:
        message = self.state
        assert message is not None
        assert message.state.tcp_mm is not None
        return message.state.tcp_mm[1]


def _waits(condition: Callable[[], bool], seconds: float) -> None:
    deadline_s = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline_s:
        time.sleep(0.005)
