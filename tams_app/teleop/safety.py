"""The arming table: when the arm may move, when it holds and when it stays stopped.

| from     | event                                                             | to              |
|----------|-------------------------------------------------------------------|-----------------|
| DISARMED | self-check passes, trigger up, operator confirms                  | READY           |
| READY    | trigger pressed, everything fresh                                 | ENGAGED         |
| ENGAGED  | trigger released                                                  | READY           |
| ENGAGED  | something stale or limited to zero                                | HOLDING(reason) |
| HOLDING  | trigger released and cause gone                                   | READY           |
| any      | error, lost device, emergency stop                                | FAULT(reason)   |
| FAULT    | trigger up and explicit confirm, cause gone                       | DISARMED        |

There is no other arrow. A confirmation in DISARMED asks the session to enable the arm and holds for
ten seconds; one in FAULT asks it to clear the arm's errors and holds for three seconds, unless a
fault comes that clearing cannot take away. A fault keeps its first reason; `blocked_by` tells what
must be gone before a confirmation counts. While DISARMED, READY or HOLDING, `reason` tells what is
in the way. `lasting` is what of them is still there.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from tams_app.teleop.reasons import Reason
from tams_app.units import NS_PER_S

__all__ = [
    "Arming",
    "ArmingEvents",
    "ArmingState",
    "Reason",
    "Request",
]

ENABLE_CONSENT_NS = 10 * NS_PER_S  # brakes and mode
CLEAR_CONSENT_NS = 3 * NS_PER_S  # the arm's errors are cleared and reported so

# What clearing the arm's errors can take away; every other fault must be gone before the confirm.
CLEARABLE = frozenset(
    {
        Reason.ARM_ERROR,
        Reason.ARM_LINK_LOST,
        Reason.ARM_REFUSES,
        Reason.GRIPPER_FAILED,
        Reason.ARM_SILENT,  # a lost connection is made anew, and only then does it report again
    }
)


class ArmingState(StrEnum):
    """Where the arm stands with the operator."""

    DISARMED = "disarmed"
    READY = "ready"
    ENGAGED = "engaged"
    HOLDING = "holding"
    FAULT = "fault"

    @property
    def is_armed(self) -> bool:
        return self in _ARMED


_ARMED = (ArmingState.READY, ArmingState.ENGAGED, ArmingState.HOLDING)


class Request(StrEnum):
    """A request to the session, to be carried out once, outside the control loop."""

    NONE = "none"
    ENABLE = "enable"
    CLEAR_ERRORS = "clear errors"


class ArmingEvents(NamedTuple):
    """The events of one tick, with the reasons that hold now in order of precedence."""

    now_ns: int
    faults: tuple[Reason, ...]
    holds: tuple[Reason, ...]
    arm_ready: bool
    confirm: bool
    press: bool  # trigger pressed just now
    pressed: bool
    released: bool  # trigger known to be up


class Arming:
    """The table as a state machine; missing input is an event, never an exception."""

    def __init__(self) -> None:
        self.state = ArmingState.DISARMED
        self.reason: Reason | None = None
        self.blocked_by: Reason | None = None
        self.lasting: Reason | None = None
        self._consent_until_ns: int | None = None

    def step(self, events: ArmingEvents) -> Request:
        """Take the arrow that `events` ask for, if the table has one."""
        request = self._step(events)
        is_there = self.reason in (*events.faults, *events.holds)
        self.lasting = self.reason if is_there else self.blocked_by
        return request

    def _step(self, events: ArmingEvents) -> Request:
        if events.faults and self.state is not ArmingState.FAULT:
            self.trip(events.faults[0])
            return Request.NONE
        take = {
            ArmingState.DISARMED: self._disarmed,
            ArmingState.READY: self._ready,
            ArmingState.ENGAGED: self._engaged,
            ArmingState.HOLDING: self._holding,
            ArmingState.FAULT: self._fault,
        }
        return take[self.state](events)

    def trip(self, reason: Reason) -> None:
        """Fault now; an earlier fault keeps its reason."""
        if self.state is not ArmingState.FAULT:
            self._enter(ArmingState.FAULT, reason)
            self.lasting = reason
        self._consent_until_ns = None

    def _disarmed(self, events: ArmingEvents) -> Request:
        blocked = _first(tuple(r for r in events.holds if r is not Reason.ARM_NOT_READY))
        self.reason = blocked
        request = Request.NONE
        if Reason.NO_OPERATOR in events.holds:
            self._consent_until_ns = None  # the next operator confirms for themselves
        if events.confirm and events.released and blocked is None:
            self._consent_until_ns = events.now_ns + ENABLE_CONSENT_NS
            if not events.arm_ready:
                request = Request.ENABLE
        if self._consents(events.now_ns) and events.arm_ready and events.released and not blocked:
            self._enter(ArmingState.READY)
        return request

    def _ready(self, events: ArmingEvents) -> Request:
        self.reason = _first(events.holds)
        if events.press and self.reason is None:
            self._enter(ArmingState.ENGAGED)
        return Request.NONE

    def _engaged(self, events: ArmingEvents) -> Request:
        if events.holds:
            self._enter(ArmingState.HOLDING, events.holds[0])
        elif not events.pressed:
            self._enter(ArmingState.READY)
        return Request.NONE

    def _holding(self, events: ArmingEvents) -> Request:
        if events.holds:
            self.reason = events.holds[0]
        elif events.released:
            self._enter(ArmingState.READY)
        return Request.NONE

    def _fault(self, events: ArmingEvents) -> Request:
        self.blocked_by = _first(tuple(r for r in events.faults if r not in CLEARABLE))
        if self.blocked_by is not None:
            self._consent_until_ns = None
            return Request.NONE
        request = Request.NONE
        if events.confirm and events.released:
            self._consent_until_ns = events.now_ns + CLEAR_CONSENT_NS
            request = Request.CLEAR_ERRORS
        if self._consents(events.now_ns) and events.released and not events.faults:
            self._enter(ArmingState.DISARMED)
        return request

    def _consents(self, now_ns: int) -> bool:
        return self._consent_until_ns is not None and now_ns <= self._consent_until_ns

    def _enter(self, state: ArmingState, reason: Reason | None = None) -> None:
        self.state = state
        self.reason = reason
        self.blocked_by = None
        self._consent_until_ns = None


def _first(reasons: tuple[Reason, ...]) -> Reason | None:
    return reasons[0] if reasons else None
