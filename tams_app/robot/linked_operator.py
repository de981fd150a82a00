"""An operator at the other end of a link, as the robot's session knows them."""

from __future__ import annotations

import math
import re
import secrets
from collections.abc import Mapping
from dataclasses import asdict

import msgspec

from hw.controller import Controller
from hw.link.controller import LinkController
from tams_app import __version__
from tams_app.config import Config
from tams_app.config.motion import WORKSPACE
from tams_app.config.section import Section
from tams_app.link.gateway_client import Endpoint, Gateway, Routes
from tams_app.link.messages import (
    OPERATOR_FOLDER_FACT,
    PROTOCOL,
    SESSION_FACT,
    SessionDescription,
    encode,
)
from tams_app.link.page_client import Page
from tams_app.link.proof import WELCOME_BYTES
from tams_app.recording.journal import Journal
from tams_app.records import Allocation, LinkHealth, Placed, Record, SessionState, SteeredBy, Tick
from tams_app.robot.ground import Ground, LiveGround
from tams_app.robot.linked_hand import LinkedHand
from tams_app.robot.linked_state import LinkedState, state_interval_ns
from tams_app.robot.operator import Operator
from tams_app.robot.senders import Senders
from tams_app.runtime.mailbox import Sentences
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import SentFrames
from tams_app.video.core.packets import receiver_ssrc
from tams_app.video.live.udp import HOST, ViewPorts

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


class LinkedOperator(Operator):
    """`receive` from any thread, `end` once the control loop has ended; else the control thread."""

    def __init__(
        self,
        ground: Ground,
        gateway: Gateway,
        sent: Mapping[str, SentFrames],
        sentences: Sentences,
        page: Page | None = None,
    ) -> None:
        """`gateway` listens (`listen`). `sent`: by view, the identities of the frames sent.

        `sentences`: those that the operator should read. `page`: which may call as well.
        """
        self._config, self._clock, self._log = ground.config, ground.clock, ground.log
        self._gateway, self._sent, self._page = gateway, sent, page
        self._sentences = sentences
        self._state = LinkedState(ground.clock)
        controller = LinkController(ground.config.link, self._receive, self._state.pulse)
        self._hand = LinkedHand(ground, controller, sent)
        self._revoked = self._placed = False
        self._introduction, self._refusal = b"", ""
        self._state_ns = state_interval_ns(math.inf)
        self._state_due_ns = self._health_due_ns = 0

    # --- start and end --------------------------------------------------------------------------

    @property
    def ports(self) -> dict[str, ViewPorts]:
        """By view, where its packets must arrive."""
        entrance = self._gateway.entrance_port
        return {view: ViewPorts(HOST, entrance, entrance, 0) for view in self._sent}

    def connect(self, entrances: Mapping[str, ViewPorts]) -> None:
        """Begin to receive; feedback goes to `entrances`, by view."""
        video = self._config.video
        ports = {receiver_ssrc(video, view): one.feedback for view, one in entrances.items()}
        self._gateway.follow(Routes(rtp={}, rtcp=ports))

    def end(self, reason: str, failed: bool) -> None:
        """Notify them that the session is over, once the control loop has ended.

        `reason`: the cause, in one sentence.
        """
        gateway = self._gateway
        self._take_sentences()
        if over := self._state.farewell(reason, failed, self._placed):
            for _ in range(_FAREWELLS):
                gateway.send(over)
                self._clock.sleep_until_ns(self._clock.now_ns() + 10 * NS_PER_MS)
        gateway.send_goodbye()

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
        for received in gateway.receive():
            hand.take(received, gateway.event.operator)
        event = gateway.event
        if self._page is not None:
            self._page.follow(event.certificate)
        if event.introduction != self._introduction:
            self._introduction = event.introduction
            if _FOLDER.fullmatch(event.introduction):
                self._log.fact(OPERATOR_FOLDER_FACT, event.introduction.decode())
        if event.refusal != self._refusal:
            self._take_sentences()
            self._refusal = event.refusal
            self._log.note("warning", event.refusal)
        if event.left:
            hand.controller.let_go(left=not event.revoked)
        if event.revoked and not self._revoked:
            name = event.operator
            self._log.note("warning", f"the key of {name} was revoked: its operator is let go")
        self._revoked = event.revoked

    # --- to the operator ------------------------------------------------------------------------

    def _take_sentences(self) -> None:
        for text in self._sentences.take():
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
        """Ask, once a tick, whether they are to be sent the session's state now."""
        if now_ns < self._state_due_ns:
            return False
        self._state_due_ns = now_ns + self._state_ns  # from tick to tick, whatever a tick takes
        return True

    def show(self, state: SessionState) -> None:
        """Send them the session's state, which is due."""
        hand = self._hand
        self._take_sentences()
        first_ns = tuple(sent.first_ns for sent in self._sent.values())
        acknowledged = hand.acknowledged
        self._gateway.send(
            self._state.datagram(state, hand.message, hand.heard_ns, acknowledged, first_ns)
        )

    def _health(self, now_ns: int) -> LinkHealth:
        event, message = self._gateway.event, self._hand.message
        clock = self._hand.controller.clock
        offset, age_ns = clock.offset, None
        if message is not None:
            age_ns = clock.age_ns(message.sent_ns, message.echo_ns, now_ns)
        return LinkHealth(
            t_ns=now_ns,
            connected=event.connected and not event.left,
            age_bound_ns=age_ns,
            offset_ns=None if offset is None else offset.offset_ns,
            uncertainty_ns=None if offset is None else offset.uncertainty_ns,
            refused=dict(self._hand.controller.refused),
            ignored=dict(event.counts),
        )


def welcome_of(config: Config, video: Senders, name: str) -> SessionDescription:
    """What an operator is told when they connect; `name`: of the session's folder."""
    return SessionDescription(
        protocol=PROTOCOL,
        version=__version__,
        session=secrets.token_hex(8),
        name=name,
        strategy=config.strategy,
        network=config.network,
        seed=config.seed,
        feedback=video.feedback,
        simulated=config.rig.enabled,
        video=config.video.model_dump(mode="json"),
        repair=asdict(video.rule),
        hand_rotation=config.hand.rotation,
        workspace=config.limits.model_dump(mode="json", include=WORKSPACE),
        driving=driving_of(config),
        stopped_after_ms=config.link.stopped_after_ms,
    )


def fitting(welcome: SessionDescription, log: Journal) -> bytes:
    """The welcome, without how the hand moves the arm where it would be too long."""
    content = encode(welcome)
    if len(content) > WELCOME_BYTES:
        content = encode(msgspec.structs.replace(welcome, driving=None))
        log.note("info", _NOT_TOLD)
    return content


def listen(ground: LiveGround, endpoint: Endpoint, welcome: SessionDescription) -> Gateway:
    """The gateway, one of the session's parts; HelperError if the address cannot be used."""
    parts, log = ground.parts, ground.log
    gateway = Gateway("robot", endpoint, fitting(welcome, log), parts.logs)
    parts.watch("link", gateway.process)
    parts.stack.callback(gateway.close)
    gateway.launch()
    gateway.wait_ready()
    log.fact(SESSION_FACT, welcome.session)
    return gateway


def serve(ground: LiveGround, page: Page, gateway: Gateway, is_alone: bool) -> None:
    """Serve the page, one of the session's parts; HelperError if that is impossible.

    `is_alone`: nobody calls but a page.
    """
    page.launch(ground.parts.logs)
    ground.parts.watch("page", page.process)
    ground.parts.stack.callback(page.close)
    page.wait_ready()
    page.let_in(gateway, is_alone)


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
