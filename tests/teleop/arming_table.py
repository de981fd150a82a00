"""The arming table as the tests understand it: docs/SAFETY.md written a second time, by itself.

`ARROWS` says in words which arrows exist; `oracle` says for one tick which of them is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from tams_app.teleop.safety import ArmingState, Reason

DISARMED, READY, ENGAGED, HOLDING, FAULT = ArmingState

ARROWS: tuple[tuple[ArmingState | None, str, ArmingState], ...] = (  # None: from any
    (DISARMED, "self-check passes, trigger up, operator confirms", READY),
    (READY, "trigger pressed, everything fresh", ENGAGED),
    (ENGAGED, "trigger released", READY),
    (ENGAGED, "something stale or limited to zero", HOLDING),
    (HOLDING, "trigger released and cause gone", READY),
    (None, "error, lost device, emergency stop", FAULT),
    (FAULT, "trigger up and explicit confirm, cause gone", DISARMED),
)


class Trigger(Enum):
    UNKNOWN = auto()  # the buttons are not read
    UP = auto()
    HELD = auto()
    PRESSED_NOW = auto()


class Consent(Enum):
    """What the operator confirmed before this tick, in the state that it is in."""

    NONE = auto()
    VALID = auto()
    RUN_OUT = auto()


@dataclass(frozen=True)
class Tick:
    """One combination of everything that can come together in one tick."""

    state: ArmingState
    consent: Consent
    trigger: Trigger
    confirm: bool
    arm_ready: bool
    holds: tuple[Reason, ...]
    faults: tuple[Reason, ...]


CAN_BE_CLEARED = {
    Reason.ARM_ERROR,
    Reason.ARM_LINK_LOST,
    Reason.ARM_REFUSES,
    Reason.GRIPPER_FAILED,
    Reason.ARM_SILENT,
}


def oracle(tick: Tick) -> ArmingState:
    """The state after `tick`."""
    up = tick.trigger is Trigger.UP
    if tick.state is not FAULT and tick.faults:
        return FAULT
    if tick.state is DISARMED:
        # That the arm is not ready yet is not in the way of confirming: that is what readies it.
        clear = not set(tick.holds) - {Reason.ARM_NOT_READY}
        agreed = tick.consent is Consent.VALID or tick.confirm
        return READY if up and clear and agreed and tick.arm_ready else DISARMED
    if tick.state is READY:
        pressed = tick.trigger is Trigger.PRESSED_NOW
        return ENGAGED if pressed and not tick.holds else READY
    if tick.state is ENGAGED:
        if tick.holds:
            return HOLDING
        return ENGAGED if tick.trigger in (Trigger.HELD, Trigger.PRESSED_NOW) else READY
    if tick.state is HOLDING:
        return READY if up and not tick.holds else HOLDING
    agreed = tick.consent is Consent.VALID or tick.confirm
    return DISARMED if up and agreed and not tick.faults else FAULT
