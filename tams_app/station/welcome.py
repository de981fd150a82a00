"""The robot side's description of its session, as the operator's side reads it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TypeVar

import msgspec

from tams_app import __version__
from tams_app.config import Config, LimitsConfig, VideoConfig
from tams_app.config.motion import ArmConfig, FreshnessConfig, HandConfig
from tams_app.config.section import Section
from tams_app.errors import ConfigError, TamsError
from tams_app.link.gateway_client import LinkEvent
from tams_app.link.messages import PROTOCOL, MessageError, SessionDescription, decode
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
    here = {"bind_host": "127.0.0.1", "first_port": 0, "encoder": "x264enc"}
    here["decoder"] = ours.video.decoder
    video = understood(VideoConfig, {**welcome.video, **here})
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
