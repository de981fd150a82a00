"""An operator at the other end of a link, as the robot's session knows them."""

from __future__ import annotations

import math
import re
import secrets
from collections.abc import Callable, Mapping
from dataclasses import asdict

import msgspec

from hw.controller import Controller
from tams_app import __version__
from tams_app.config import Config
from tams_app.config.motion import WORKSPACE
from tams_app.config.section import Section
from tams_app.link.ends import WELCOME_BYTES
from tams_app.link.gateway_client import Gateway, LinkEvent, Routes
from tams_app.link.messages import (
    OPERATOR_FOLDER_FACT,
    PROTOCOL,
    SESSION_FACT,
    SessionDescription,
    encode,
)
from tams_app.recording.journal import Journal
from tams_app.records import Allocation, LinkHealth, Placed, Record, SessionState, SteeredBy, Tick
from tams_app.robot.control import Signals
from tams_app.robot.linked_hand import LinkedHand
from tams_app.robot.linked_state import LinkedState, state_interval_ns
from tams_app.robot.operator import StreamedOperator
from tams_app.runtime.clock import Clock
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import SentFrames
from tams_app.video.core.packets import receiver_ssrc
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.udp import ViewPorts

_HEALTH_NS = NS_PER_S // 10
_FAREWELLS = 5
_FOLDER = re.compile(rb"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")  # as a session's is called
_ARM = {
    "model",
    "tcp_offset_mm_deg",
    "ready_joints_deg",
    "velocity_deadman_s",
}
_FRESHNESS = {"hold_pose_ms", "buttons_ms"}
_NOT_TOLD = (
    "so much of the configuration is not as by default that an operator's side is not told how the "
    "hand moves the arm: `operate --predict` shows frames as received"
)


class LinkedOperator(StreamedOperator):
    """Owner of the gateway; `open`, then `close`, `note` and `receive` from any thread.

    All else is for the control thread.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        signals: Signals,
        log: Journal,
        make_gateway: Callable[[bytes], Gateway],
        name: str,
    ) -> None:
        """`make_gateway`: of what an operator receives when they connect.

        `name`: of the session's folder.
        """
        self._config, self._clock, self._log = config, clock, log
        self._make_gateway, self._name = make_gateway, name
        self._gateway: Gateway | None = None
        self._state = LinkedState(clock)
        self._hand = LinkedHand(config, signals, log, self._receive, self._state.pulse)
        self._sent: Mapping[str, SentFrames] = {}
        self._revoked = self._placed = False
        self._introduction, self._refusal = b"", ""
        self._state_ns = state_interval_ns(math.inf)
        self._state_due_ns = self._health_due_ns = 0

    # --- start and end --------------------------------------------------------------------------

    def open(
        self, rule: RepairRule, feedback: bool, sent: Mapping[str, SentFrames]
    ) -> dict[str, ViewPorts]:
        """Listen for an operator; HelperError if the address cannot be used."""
        config = self._config
        self._sent = sent
        self._hand.follow(sent)
        welcome = SessionDescription(
            protocol=PROTOCOL,
            version=__version__,
            session=secrets.token_hex(8),
            name=self._name,
            strategy=config.strategy,
            network=config.network,
            seed=config.seed,
            feedback=feedback,
            simulated=config.rig.enabled,
            video=config.video.model_dump(mode="json"),
            repair=asdict(rule),
            hand_rotation=config.hand.rotation,
            workspace=config.limits.model_dump(mode="json", include=WORKSPACE),
            driving=driving_of(config),
            stopped_after_ms=config.link.stopped_after_ms,
        )
        content = encode(welcome)
        if len(content) > WELCOME_BYTES:
            content = encode(msgspec.structs.replace(welcome, driving=None))
            self._log.note("info", _NOT_TOLD)
        self._gateway = gateway = self._make_gateway(content)
        gateway.launch()
        gateway.wait_ready()
        self._log.fact(SESSION_FACT, welcome.session)
        entrance = gateway.entrance_port
        host = config.video.bind_host
        return {view: ViewPorts(host, entrance, entrance, 0) for view in sent}

    def connect(self, entrances: Mapping[str, ViewPorts]) -> None:
        assert self._gateway is not None, "open it first"
        video = self._config.video
        ports = {receiver_ssrc(video, view): one.feedback for view, one in entrances.items()}
        self._gateway.follow(Routes(rtp={}, rtcp=ports))

    @property
    def event(self) -> LinkEvent | None:
        """The state of the link; None before it is open."""
        return None if self._gateway is None else self._gateway.event

    @property
    def is_there(self) -> bool:
        """True if an operator is connected now."""
        event = self.event
        return event is not None and event.connected and not event.left

    def poll(self) -> str:
        return ""  # the gateway is one of the helper processes that are watched

    def end(self, reason: str, failed: bool) -> None:
        gateway = self._gateway
        if gateway is None:
            return
        if over := self._state.farewell(reason, failed, self._placed):
            for _ in range(_FAREWELLS):
                gateway.send(over)
                self._clock.sleep_until_ns(self._clock.now_ns() + 10 * NS_PER_MS)
        gateway.send_goodbye()

    def close(self) -> None:
        if self._gateway is not None:
            self._gateway.close()

    # --- from the operator ----------------------------------------------------------------------

    def take_controller(self) -> Controller:
        self._hand.controller.start()
        return self._hand.controller

    @property
    def hand(self) -> str:
        return self._hand.hand

    @property
    def is_simulated(self) -> bool:
        return self._hand.is_simulated

    def steered_by(self, view: str) -> SteeredBy:
        return self._hand.steered_by(view)

    def _receive(self, now_ns: int) -> None:
        gateway, hand = self._gateway, self._hand
        if gateway is None:
            return
        for received in gateway.receive():
            hand.take(received, gateway.event.operator)
        event = gateway.event
        if event.introduction != self._introduction:
            self._introduction = event.introduction
            if _FOLDER.fullmatch(event.introduction):
                self._log.fact(OPERATOR_FOLDER_FACT, event.introduction.decode())
        if event.refusal != self._refusal:
            self._refusal = event.refusal
            self._log.note("warning", event.refusal)
        if event.left:
            hand.controller.let_go(left=not event.revoked)
        if event.revoked and not self._revoked:
            name = event.operator
            self._log.note("warning", f"the key of {name} was revoked: its operator is let go")
        self._revoked = event.revoked

    # --- to the operator ------------------------------------------------------------------------

    def note(self, text: str) -> None:
        if text != self._refusal:  # an operator is shown nothing of others' calls
            self._state.note(text)

    def on_wake(self, now_ns: int) -> None:
        self._hand.wake(now_ns)

    def receive(self, record: Record) -> None:
        if isinstance(record, Allocation):
            self._state_ns = state_interval_ns(record.capacity_kbps)
        elif isinstance(record, Placed):
            self._placed = record.placed
        elif isinstance(record, Tick):
            self._hand.is_armed = ArmingState(record.arming).is_armed
            if record.started_ns >= self._health_due_ns:
                self._health_due_ns = record.started_ns + _HEALTH_NS
                self._log.record(self._health(record.started_ns))

    def wants_state(self, now_ns: int) -> bool:
        if self._gateway is None or now_ns < self._state_due_ns:
            return False
        self._state_due_ns = now_ns + self._state_ns  # from tick to tick, whatever a tick takes
        return True

    def show(self, state: SessionState) -> None:
        assert self._gateway is not None, "open it first"
        hand = self._hand
        first_ns = tuple(sent.first_ns for sent in self._sent.values())
        acknowledged = hand.acknowledged
        self._gateway.send(
            self._state.datagram(state, hand.message, hand.heard_ns, acknowledged, first_ns)
        )

    def _health(self, now_ns: int) -> LinkHealth:
        event, message, clock = self.event, self._hand.message, self._hand.controller.clock
        offset, age_ns = clock.offset, None
        if message is not None:
            age_ns = clock.age_ns(message.sent_ns, message.echo_ns, now_ns)
        return LinkHealth(
            t_ns=now_ns,
            connected=self.is_there,
            age_bound_ns=age_ns,
            offset_ns=None if offset is None else offset.offset_ns,
            uncertainty_ns=None if offset is None else offset.uncertainty_ns,
            refused=dict(self._hand.controller.refused),
            ignored={} if event is None else dict(event.counts),
        )


def driving_of(config: Config) -> dict[str, dict[str, object]]:
    """`SessionDescription.driving`."""

    def told(
        section: Section, include: set[str] | None = None, exclude: set[str] | None = None
    ) -> dict[str, object]:
        return section.model_dump(
            mode="json", exclude_defaults=True, include=include, exclude=exclude
        )

    found = {
        "arm": told(config.arm, include=_ARM),
        "freshness": told(config.freshness, include=_FRESHNESS),
        "hand": told(config.hand, exclude={"rotation"}),
        "limits": told(config.limits, exclude=WORKSPACE),
    }
    return {name: values for name, values in found.items() if values}
