"""The operator's side as the robot's session knows it: samples in, state out."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from dataclasses import asdict

import msgspec

from hw.link.controller import LinkController
from tams_app import __version__
from tams_app.config import Config
from tams_app.link.age import OffsetEstimate, age_bound_ns
from tams_app.link.gateway import LinkEvent, Routes
from tams_app.link.gateway_client import Gateway, Received
from tams_app.link.messages import (
    PROTOCOL,
    STATE_RATE_HZ,
    HandMessage,
    MessageError,
    StateMessage,
    Welcome,
    decode,
    encode,
)
from tams_app.link.sealing import LONGEST_MESSAGE_BYTES
from tams_app.records import (
    ArmState,
    HandHeard,
    Haptic,
    LinkHealth,
    Presses,
    SessionState,
    Tick,
)
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.session.confirmation import CONFIRMED_AGO_NS, TOO_LONG_AGO
from tams_app.session.control import Signals
from tams_app.session.listener import Listener
from tams_app.session.recorders import SessionRecords
from tams_app.session.two_sided.welcome import workspace_of
from tams_app.summary.joined import SESSION_FACT
from tams_app.teleop.hands import HAND_FACT, HANDS, hand_of
from tams_app.teleop.records import TeleopOutput
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.repair import RepairRule

_STATE_NS = round(NS_PER_S / STATE_RATE_HZ) - NS_PER_S // 1000  # of a tick's time, some less
_HEALTH_NS = NS_PER_S // 10
_NOTES_KEPT = 3
_NOTE_BYTES = 220
_FAREWELLS = 5


class RobotLink(Listener):
    """Owner of the gateway; `open`, then everything but `close` and `note` in the control thread.

    `controller`: the controller in the operator's hand.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        signals: Signals,
        log: SessionRecords,
        make_gateway: Callable[[bytes], Gateway],
        state_at: Callable[[int], SessionState],
    ) -> None:
        """`make_gateway`: of what an operator is told when they connect.

        `state_at`: of this side at a time, asked for in the control thread.
        """
        self._config, self._clock, self._signals, self._log = config, clock, signals, log
        self._make_gateway = make_gateway
        self._gateway: Gateway | None = None
        self.controller = LinkController(config.link, self._receive, self._pulse)
        self._views = config.video.views
        self._first_capture_ns: Callable[[str], int | None] = lambda _view: None
        self._told: set[str] = set()
        self._session = 0
        self._revoked = False
        self._operator: int | None = None
        self._message: HandMessage | None = None  # the newest, whether it counted or not
        self._message_heard_ns = 0
        self._shown: dict[str, int | None] = dict.fromkeys(self._views)
        self._damaged: dict[str, bool] = dict.fromkeys(self._views, False)
        self._confirms = self._stops = self._menu_presses = 0
        self._awake_ns = 0  # since this computer was suspended last
        self._offset = OffsetEstimate()
        self._state_at = state_at
        self._is_armed = False
        self.hand = hand_of(config)  # what drives the arm, of `HANDS`
        self._haptics, self._haptic = 0, ""
        self._notes: tuple[int, tuple[str, ...]] = (0, ())
        self._notes_lock = threading.Lock()
        self._state_due_ns = self._health_due_ns = 0
        self._state: StateMessage | None = None

    # --- start and end --------------------------------------------------------------------------

    def open(
        self,
        rule: RepairRule,
        feedback: bool,
        first_capture_ns: Callable[[str], int | None],
    ) -> int:
        """Listen for an operator; the port on loopback for the streams that are for them.

        `first_capture_ns`: of a view's frame with RTP timestamp 0. HelperError if the address
        cannot be used.
        """
        config = self._config
        self._first_capture_ns = first_capture_ns
        welcome = Welcome(
            protocol=PROTOCOL,
            version=__version__,
            session=secrets.token_hex(8),
            name=config.name,
            strategy=config.strategy,
            network=config.network,
            seed=config.seed,
            feedback=feedback,
            simulated=config.rig.enabled,
            video=config.video.model_dump(mode="json"),
            repair=asdict(rule),
            hand_rotation=config.hand.rotation,
            workspace=workspace_of(config),
            stopped_after_ms=config.link.stopped_after_ms,
        )
        self._gateway = gateway = self._make_gateway(encode(welcome))
        gateway.launch()
        gateway.wait_ready()
        self._log.fact(SESSION_FACT, welcome.session)
        return gateway.entrance_port

    def follow(self, routes: Routes) -> None:
        """Where what the operator's streams send is to go."""
        assert self._gateway is not None, "open it first"
        self._gateway.follow(routes)

    @property
    def process(self) -> HelperProcess:
        """The gateway's process."""
        assert self._gateway is not None, "open it first"
        return self._gateway.process

    @property
    def event(self) -> LinkEvent | None:
        """How the link stands; None before it is open."""
        return None if self._gateway is None else self._gateway.event

    @property
    def port(self) -> int:
        """Where the operator's side must call."""
        return 0 if self._gateway is None else self._gateway.port

    def end(self, reason: str, failed: bool) -> None:
        """Tell the operator's side that the session is over, and why; once the loop has ended."""
        gateway, state = self._gateway, self._state
        if gateway is None:
            return
        if state is not None:
            over = _datagram(self._telling(state, reason, failed))
            for _ in range(_FAREWELLS):
                gateway.send(over)
                self._clock.sleep_until_ns(self._clock.now_ns() + 10 * NS_PER_MS)
        gateway.say_goodbye()

    def close(self) -> None:
        """End the gateway; may be called twice."""
        if self._gateway is not None:
            self._gateway.close()

    @property
    def operator_is_simulated(self) -> bool:
        """Whether no person holds the controller, as far as is known."""
        return self._message is None or self._message.simulated

    # --- from the operator ----------------------------------------------------------------------

    def shown_timestamp(self, view: str) -> int | None:
        """RTP timestamp of the newest frame of `view` that counts on the operator's side."""
        return self._shown[view]

    def shows_damage(self, view: str) -> bool:
        """Whether the operator's side shows a newer frame of `view`, which is not whole."""
        return self._damaged[view]

    def _receive(self, now_ns: int) -> None:
        gateway = self._gateway
        if gateway is None:
            return
        for received in gateway.receive():
            try:
                self._take(received, decode(received.content, HandMessage))
            except MessageError as error:
                self.controller.refused["not understood"] += 1
                self._tell_once(f"messages of the operator's side are left out: {error}")
        if gateway.event.left:
            self.controller.let_go()
        if gateway.event.revoked and not self._revoked:
            name = gateway.event.operator
            self._log.note("warning", f"the key of {name} was revoked: its operator is let go")
        self._revoked = gateway.event.revoked

    def _take(self, received: Received, message: HandMessage) -> None:
        if received.session != self._session:
            self._session = received.session
            self.controller.let_go()
            self._offset = OffsetEstimate()
            self._shown = dict.fromkeys(self._views)
            self._damaged = dict.fromkeys(self._views, False)
            self._log.note("info", f"an operator is connected{_with_key(self.event)}")
        if message.operator != self._operator:
            self._operator = message.operator
            self._confirms = self._stops = 0
            self._menu_presses = Presses(*message.presses).menu
        heard_ns = received.heard_ns
        if message.simulated and not self._config.rig.enabled:
            self._tell_once("a simulated operator moves no real arm: its samples are left out")
            return
        if message.hand != self.hand and message.hand in HANDS:
            self.hand = message.hand
            self._log.fact(HAND_FACT, message.hand)
        refusal = self.controller.take(message, heard_ns)
        bound_ns = age_bound_ns(heard_ns, message.echo_ns, self._awake_ns)
        self._offset.step(message.echo_ns, message.echo_heard_ns, message.sent_ns, heard_ns)
        self._message, self._message_heard_ns = message, heard_ns
        for view, timestamp in zip(self._views, message.shown, strict=False):
            self._shown[view] = timestamp
        self._damaged.update(zip(self._views, message.damaged, strict=False))
        if message.stops > self._stops:  # however old it is
            self._stops = message.stops
            self._signals.estop()
        menu_presses = Presses(*message.presses).menu
        if menu_presses > self._menu_presses:  # also one that no sample has shown
            self._menu_presses = menu_presses
            if self._is_armed:
                self._signals.estop()
        if message.confirms > self._confirms:
            self._confirms = message.confirms
            ago_ns = (bound_ns or 0) + message.sent_ns - message.confirmed_ns
            if bound_ns is not None and 0 <= ago_ns <= CONFIRMED_AGO_NS:
                self._signals.confirm()
            else:
                self._log.note("warning", TOO_LONG_AGO)
        self._log.record(
            HandHeard(
                t_ns=heard_ns,
                sent_ns=message.sent_ns,
                pose_ns=message.pose_ns,
                echo_ns=message.echo_ns,
                refusal=refusal,
                operator=message.operator,
            )
        )

    def _tell_once(self, sentence: str) -> None:
        if sentence not in self._told:
            self._told.add(sentence)
            self._log.note("warning", sentence)

    # --- to the operator ------------------------------------------------------------------------

    def note(self, text: str) -> None:
        """A sentence that the operator should read; from any thread."""
        with self._notes_lock:
            noted, notes = self._notes
            self._notes = (noted + 1, (*notes, cut(text))[-_NOTES_KEPT:])

    def _pulse(self, haptic: Haptic) -> None:
        self._haptics += 1
        self._haptic = haptic.value

    def on_wake(self, now_ns: int) -> None:
        self._awake_ns = now_ns
        self.controller.wake(now_ns)

    def on_output(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        self._is_armed = output.arming.is_armed

    def on_tick(self, tick: Tick) -> None:
        now_ns = tick.started_ns
        if now_ns >= self._state_due_ns and self._gateway is not None:
            self._state_due_ns = now_ns + _STATE_NS
            self._state = self._state_now()
            self._gateway.send(_datagram(self._state))
        if now_ns >= self._health_due_ns:
            self._health_due_ns = now_ns + _HEALTH_NS
            self._log.record(self._health(now_ns))

    def _state_now(self) -> StateMessage:
        sent_ns, message = self._clock.now_ns(), self._message
        noted, notes = self._notes
        new = notes[-max(0, noted - message.noted) :] if message and message.noted < noted else ()
        state = self._state_at(sent_ns)
        return StateMessage(
            sent_ns=sent_ns,
            echo_ns=0 if message is None else message.sent_ns,
            echo_heard_ns=self._message_heard_ns,
            state=msgspec.structs.replace(state, reason=cut(state.reason)),
            first_capture_ns=tuple(map(self._first_capture_ns, self._views)),
            haptics=self._haptics,
            haptic=self._haptic,
            confirms=self._confirms,
            stops=self._stops,
            noted=noted,
            notes=new,
            ended="",
            failed=False,
        )

    def _telling(self, state: StateMessage, reason: str, failed: bool) -> StateMessage:
        """The last state, with the end of the session and the last sentences in it."""
        noted, notes = self._notes
        return msgspec.structs.replace(
            state,
            sent_ns=self._clock.now_ns(),
            noted=noted,
            notes=notes,
            ended=cut(reason or "the session is over"),
            failed=failed,
        )

    def _health(self, now_ns: int) -> LinkHealth:
        clock, event, message = self._offset.now, self.event, self._message
        return LinkHealth(
            t_ns=now_ns,
            connected=event is not None and event.connected and not event.left,
            age_bound_ns=None if message is None else age_bound_ns(now_ns, message.echo_ns),
            offset_ns=None if clock is None else clock.offset_ns,
            uncertainty_ns=None if clock is None else clock.uncertainty_ns,
            refused=dict(self.controller.refused),
            ignored={} if event is None else dict(event.counts),
        )


def _with_key(event: LinkEvent | None) -> str:
    """Whose key the operator has, where they have one."""
    return f", with the key of {event.operator}" if event is not None and event.operator else ""


def _datagram(state: StateMessage) -> bytes:
    """The message, without the oldest of its sentences where it would be too long with them."""
    content = encode(state)
    while len(content) > LONGEST_MESSAGE_BYTES and state.notes:
        state = msgspec.structs.replace(state, notes=state.notes[1:])
        content = encode(state)
    return content


def cut(text: str) -> str:
    """A sentence in at most 220 bytes."""
    return text.encode()[:_NOTE_BYTES].decode(errors="ignore")
