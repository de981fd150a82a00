"""The operator's side calls the robot's: until it is answered, and what follows from the answer."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TypeVar

import msgspec

from tams_app import __version__
from tams_app.config import Config, LimitsConfig, VideoConfig
from tams_app.config.motion import ArmConfig, FreshnessConfig, HandConfig
from tams_app.config.section import Section
from tams_app.errors import ConfigError, HelperError, TamsError
from tams_app.link.addresses import called
from tams_app.link.gateway_client import NO_ANSWER, Endpoint, Gateway, LinkEvent
from tams_app.link.messages import (
    OPERATOR_FACT,
    PROTOCOL,
    ROBOT_FOLDER_FACT,
    SESSION_FACT,
    MessageError,
    SessionDescription,
    decode,
)
from tams_app.recording.journal import Journal
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Ending, Parts
from tams_app.station.seat import require_local_seat
from tams_app.teleop.hands import HAND_FACT, hand_of
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.repair import RepairRule

Part = TypeVar("Part", bound=Section)
_DRIVING: dict[str, type[Section]] = {
    "arm": ArmConfig,
    "freshness": FreshnessConfig,
    "hand": HandConfig,
    "limits": LimitsConfig,
}
_NOT_KNOWN = (
    "the robot's side has a configuration that this version of TAMS does not know: "
    "install the same version on both computers"
)


def welcome_of(event: LinkEvent) -> SessionDescription | None:
    """The robot side's description of its session; None until it has answered.

    TamsError if it speaks another version of the protocol.
    """
    if event.welcome is None:
        return None
    try:
        welcome = decode(event.welcome, SessionDescription)
    except MessageError as error:
        raise TamsError(
            "the robot's side runs a version of TAMS that this one does not understand: "
            "install the same on both computers"
        ) from error
    if welcome.protocol != PROTOCOL:
        raise TamsError(
            f"the robot's side runs TAMS {welcome.version}, which this one ({__version__}) "
            "does not understand: install the same on both computers"
        )
    return welcome


def follow(welcome: SessionDescription, ours: Config) -> Config:
    """Our configuration for the session that the robot's side runs.

    With its video, its workspace, which the operator is shown, and its rotation of the hand, since
    a device on a desk moves the hand in the arm's frame. ConfigError if it has other views.
    """
    video = understood(VideoConfig, welcome.video)
    if video.views != ours.video.views:
        raise ConfigError(
            f"the robot's side has the views {', '.join(video.views)}, this configuration "
            f"{', '.join(ours.video.views)}: give both the same"
        )
    hand = ours.hand.model_copy(update={"rotation": welcome.hand_rotation})
    limits = understood(LimitsConfig, {**ours.limits.model_dump(), **welcome.workspace})
    update = {
        "strategy": welcome.strategy,
        "network": welcome.network,
        "video": video,
        "hand": hand,
        "limits": limits,
    }
    return ours.model_copy(update=update)


def driven(welcome: SessionDescription, ours: Config) -> Config | None:
    """Our configuration with the arm, hand and limits of the robot's side, which it moves by.

    None: not known. TamsError if a section of it is none here.
    """
    if welcome.driving is None:
        return None
    told = {name: dict(welcome.driving.get(name, {})) for name in _DRIVING}
    told["hand"]["rotation"] = welcome.hand_rotation
    told["limits"] |= welcome.workspace
    sections = {name: understood(kind, told[name]) for name, kind in _DRIVING.items()}
    rig = ours.rig.model_copy(update={"enabled": welcome.simulated})
    return ours.model_copy(update={**sections, "rig": rig})


def repair_of(welcome: SessionDescription) -> RepairRule:
    """The repair of the robot side's video; TamsError if that is no rule here."""
    try:
        rule = RepairRule(**welcome.repair)  # type: ignore[arg-type]
        return msgspec.convert(asdict(rule), RepairRule)
    except (TypeError, msgspec.MsgspecError) as error:
        raise TamsError(_NOT_KNOWN) from error


def understood(kind: type[Part], values: dict[str, object]) -> Part:
    """A section of the configuration as the robot's side sent it; TamsError if it is none here."""
    try:
        return kind.model_validate(values)
    except ValueError as error:
        raise TamsError(_NOT_KNOWN) from error


_CALL_POLL_NS = 50 * NS_PER_MS
_NOTIFY_AFTER_NS = 2 * NS_PER_S  # of waiting, and again
# the robot's side waits for one who fell silent, who may be the one who calls again
BUSY = "another operator is connected, or was a moment ago: waiting until they leave"


@dataclass(frozen=True, slots=True)
class RobotCall:
    """A call that was answered. `config`: ours, for the session that the robot's side runs.

    moves_by: ours with what decides there how the hand moves the arm; None: not known.
    hand: the operator's kind of controller, of `HANDS`. rule: the repair of the robot side's video.
    identity: a random number, another one for each application that calls.
    """

    gateway: Gateway
    welcome: SessionDescription
    config: Config
    moves_by: Config | None
    hand: str
    rule: RepairRule
    identity: int

    def record(self, log: Journal) -> None:
        """Record the facts by which a reader joins this log with that of the robot's side."""
        log.fact(SESSION_FACT, self.welcome.session)
        log.fact(ROBOT_FOLDER_FACT, self.welcome.name)
        log.fact(OPERATOR_FACT, str(self.identity))
        log.fact(HAND_FACT, self.hand)


def call_robot(
    config: Config,
    clock: Clock,
    endpoint: Endpoint,
    parts: Parts,
    ending: Ending,
    notify: Callable[[str], None],
    name: str,
) -> RobotCall:
    """Wait for the robot's side to answer; TamsError if we are ended before, or cannot follow it.

    `notify` shows a sentence at once. `name`: of the folder here, for the robot's side.
    """
    if config.rig.hand_trajectory is not None:
        raise ConfigError("rig.hand_trajectory: a recorded hand sees nothing, `operate` must see")
    gateway = Gateway("operator", endpoint, name.encode(), parts.logs)
    parts.stack.callback(gateway.close)
    gateway.launch()
    gateway.wait_ready()
    welcome = _answer(gateway, clock, endpoint, parts, ending, notify)
    parts.watch("link", gateway.process)
    if config.operator_is_simulated and not welcome.simulated:
        raise ConfigError("--sim: the robot there is real, and moves for a person only")
    if config.controller.device == "keyboard":
        require_local_seat(config, not welcome.simulated, "the desktop")
    ours = follow(welcome, config)
    moves_by, rule = driven(welcome, ours), repair_of(welcome)
    return RobotCall(
        gateway, welcome, ours, moves_by, hand_of(ours), rule, identity=secrets.randbits(62)
    )


def _answer(
    gateway: Gateway,
    clock: Clock,
    endpoint: Endpoint,
    parts: Parts,
    ending: Ending,
    notify: Callable[[str], None],
) -> SessionDescription:
    reported_ns, busy = clock.now_ns(), False
    where = called(endpoint.host, endpoint.port)
    while (welcome := welcome_of(gateway.event)) is None:
        gateway.receive()
        now_ns, event = clock.now_ns(), gateway.event
        if gateway.process.exit_code is not None:
            raise HelperError(f"the gateway ended unasked; see {parts.logs}")
        if ending.requested_end:
            raise TamsError(f"{ending.requested_end} before the robot's side had answered")
        if ending.time_is_up:
            what = "another operator was connected" if busy else NO_ANSWER
            raise TamsError(f"{what} (called {where} for {ending.limit_s:g} s)")
        if now_ns - reported_ns >= _NOTIFY_AFTER_NS or event.busy != busy:
            reported_ns, busy = now_ns, event.busy
            notify(BUSY if busy else f"calling {where}: {NO_ANSWER}")
        clock.sleep_until_ns(now_ns + _CALL_POLL_NS)
    return welcome
