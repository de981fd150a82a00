"""From a word in the configuration to a controller; vendors' libraries are loaded when used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hw.controller import Controller
from tams_app.config import ControllerConfig, HandConfig
from tams_app.records import TakeNote
from tams_app.registry import Registry
from tams_app.runtime.clock import Clock


@dataclass(frozen=True, slots=True)
class ControllerParts:
    """The parts that a maker of controllers is given."""

    config: ControllerConfig
    """`controller` of the configuration."""
    hand: HandConfig
    """`hand`: how motions of the hand become motions of the arm."""
    clock: Clock
    """The session's clock, by which samples are stamped."""
    note: TakeNote
    """For what the operator should read, such as a device that came back."""


def make_controller(
    config: ControllerConfig, hand: HandConfig, clock: Clock, note: TakeNote
) -> Controller:
    """Make the configured controller.

    Args:
        config: `controller`; its `device` is a key of `DEVICES`, or `auto`: the tracked one.
        hand: `hand` of the configuration.
        clock: the session's.
        note: called with level and sentence, from any thread.

    Returns:
        The controller, not started yet.

    Raises:
        ConfigError: there is no such device.
    """
    device = "openvr" if config.device == "auto" else config.device
    return DEVICES[device](ControllerParts(config, hand, clock, note))


def _openvr(parts: ControllerParts) -> Controller:
    from hw.openvr.controller import OpenVrController

    return OpenVrController(parts.config, parts.clock, parts.note)


def _keyboard(parts: ControllerParts) -> Controller:
    from hw.desk.keyboard import KeyboardController

    return KeyboardController(parts.config.desk, parts.hand.rotation)


DEVICES: Registry[Callable[[ControllerParts], Controller]] = Registry(
    "controller.device",
    "tams.controllers",
    {
        "openvr": _openvr,
        "keyboard": _keyboard,
    },
)
"""Makers of a controller by their word for `controller.device`; entry points of `tams.controllers`.
"""
