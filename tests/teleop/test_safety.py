"""Every arrow of the arming table, and every arrow it does not have."""

from __future__ import annotations

import itertools

import pytest

from tams_app.clock import NS_PER_S
from tams_app.teleop.safety import (
    CLEAR_CONSENT_NS,
    CLEARABLE,
    ENABLE_CONSENT_NS,
    Arming,
    ArmingEvents,
    ArmingState,
    Reason,
    Request,
    describe_arm_error,
)

DISARMED, READY, ENGAGED, HOLDING, FAULT = ArmingState

UP = {"released": True}
DOWN = {"pressed": True}
PRESS = {"pressed": True, "press": True}
UNKNOWN: dict[str, object] = {}  # no buttons are read: neither up nor down
STALE = {"holds": (Reason.ARM_STATE_STALE,)}
LOST = {"faults": (Reason.GUARD_LOST,)}


def events(now_ns: int = NS_PER_S, **given: object) -> ArmingEvents:
    nothing = {
        "faults": (),
        "holds": (),
        "arm_ready": True,
        "confirm": False,
        "press": False,
        "pressed": False,
        "released": False,
    }
    return ArmingEvents(now_ns=now_ns, **{**nothing, **given})  # type: ignore[arg-type]


def arming_in(state: ArmingState) -> Arming:
    """Led to `state` by the table's own arrows."""
    arming = Arming()
    if state is FAULT:
        arming.step(events(**LOST))
    elif state is not DISARMED:
        arming.step(events(confirm=True, **UP))
        if state is not READY:
            arming.step(events(**PRESS))
        if state is HOLDING:
            arming.step(events(**STALE, **DOWN))
    assert arming.state is state
    return arming


@pytest.mark.parametrize(
    ("start", "given", "end"),
    [
        (DISARMED, {"confirm": True, **UP}, READY),
        (READY, PRESS, ENGAGED),
        (ENGAGED, UP, READY),
        (ENGAGED, UNKNOWN, READY),
        (ENGAGED, {**STALE, **DOWN}, HOLDING),
        (ENGAGED, {**STALE, **UP}, HOLDING),
        (HOLDING, UP, READY),
        (FAULT, {"confirm": True, **UP}, DISARMED),
        *((state, {**LOST, **UP}, FAULT) for state in ArmingState),
        *((state, {**LOST, **PRESS, "confirm": True}, FAULT) for state in ArmingState),
    ],
)
def test_an_arrow_of_the_table_is_taken(
    start: ArmingState, given: dict[str, object], end: ArmingState
) -> None:
    arming = arming_in(start)
    arming.step(events(**given))
    assert arming.state is end


@pytest.mark.parametrize(
    ("start", "given"),
    [
        (DISARMED, UP),
        (DISARMED, PRESS),
        (DISARMED, {"confirm": True, **DOWN}),
        (DISARMED, {"confirm": True, **UNKNOWN}),
        (DISARMED, {"confirm": True, "arm_ready": False, **UP}),
        (DISARMED, {"confirm": True, **UP, **STALE}),
        (READY, UP),
        (READY, DOWN),  # held, but not pressed just now
        (READY, UNKNOWN),
        (READY, {**PRESS, **STALE}),
        (READY, {"confirm": True, **UP}),
        (ENGAGED, DOWN),
        (ENGAGED, {"confirm": True, **DOWN}),
        (HOLDING, DOWN),
        (HOLDING, PRESS),
        (HOLDING, UNKNOWN),
        (HOLDING, {**UP, **STALE}),
        (HOLDING, {"confirm": True, **DOWN}),
        (FAULT, UP),
        (FAULT, PRESS),
        (FAULT, {"confirm": True, **DOWN}),
        (FAULT, {"confirm": True, **UNKNOWN}),
        (FAULT, {"confirm": True, **UP, **LOST}),
    ],
)
def test_an_arrow_the_table_lacks_is_not_taken(
    start: ArmingState, given: dict[str, object]
) -> None:
    arming = arming_in(start)
    arming.step(events(**given))
    assert arming.state is start


def test_no_event_at_all_leads_along_an_arrow_the_table_lacks() -> None:
    allowed = {
        (DISARMED, READY),
        (READY, ENGAGED),
        (ENGAGED, READY),
        (ENGAGED, HOLDING),
        (HOLDING, READY),
        (FAULT, DISARMED),
        *((state, FAULT) for state in ArmingState),
        *((state, state) for state in ArmingState),
    }
    seen = set()
    switches = list(itertools.product((False, True), repeat=6))
    for start in ArmingState:
        for confirm, press, down, stale, lost, ready in switches:
            arming = arming_in(start)
            given = {**(PRESS if press else DOWN if down else UP)}
            given |= STALE if stale else {}
            given |= LOST if lost else {}
            arming.step(events(confirm=confirm, arm_ready=ready, **given))
            seen.add((start, arming.state))
    assert seen == allowed


def test_confirming_disarmed_asks_once_to_enable_and_waits_for_the_arm() -> None:
    arming = Arming()
    assert arming.step(events(confirm=True, arm_ready=False, **UP)) is Request.ENABLE
    assert arming.step(events(arm_ready=False, **UP)) is Request.NONE
    assert arming.state is DISARMED
    arming.step(events(arm_ready=True, **DOWN))
    assert arming.state is DISARMED
    arming.step(events(arm_ready=True, **UP))
    assert arming.state is READY


def test_consent_to_enable_runs_out() -> None:
    arming = Arming()
    arming.step(events(confirm=True, arm_ready=False, **UP))
    arming.step(events(now_ns=NS_PER_S + ENABLE_CONSENT_NS + 1, **UP))
    assert arming.state is DISARMED


def test_a_fault_withdraws_the_consent_to_enable() -> None:
    arming = Arming()
    arming.step(events(confirm=True, arm_ready=False, **UP))
    arming.step(events(**LOST, **UP))
    arming.step(events(confirm=True, **UP))
    assert arming.state is DISARMED
    arming.step(events(**UP))
    assert arming.state is DISARMED


@pytest.mark.parametrize("clearable", sorted(CLEARABLE, key=lambda reason: reason.label))
def test_confirming_an_arm_error_asks_to_clear_it_and_disarms_once_it_is_gone(
    clearable: Reason,
) -> None:
    arming = Arming()
    arming.step(events(faults=(clearable,), **UP))
    request = arming.step(events(faults=(clearable,), confirm=True, **UP))
    assert (request, arming.state) == (Request.CLEAR_ERRORS, FAULT)
    assert arming.step(events(faults=(clearable,), **UP)) is Request.NONE
    arming.step(events(**UP))
    assert arming.state is DISARMED


def test_consent_to_clear_errors_runs_out() -> None:
    arming = Arming()
    arming.step(events(faults=(Reason.ARM_ERROR,), **UP))
    arming.step(events(faults=(Reason.ARM_ERROR,), confirm=True, **UP))
    arming.step(events(now_ns=NS_PER_S + CLEAR_CONSENT_NS + 1, **UP))
    assert arming.state is FAULT


def test_an_emergency_stop_in_fault_withdraws_the_consent() -> None:
    arming = Arming()
    arming.step(events(faults=(Reason.ARM_ERROR,), **UP))
    arming.step(events(faults=(Reason.ARM_ERROR,), confirm=True, **UP))
    arming.step(events(faults=(Reason.EMERGENCY_STOP,), confirm=True, **UP))
    arming.step(events(**UP))
    assert arming.state is FAULT


def test_a_fault_keeps_its_first_reason() -> None:
    arming = arming_in(FAULT)
    arming.step(events(faults=(Reason.EMERGENCY_STOP,), **UP))
    arming.trip(Reason.TRAJECTORY_ERROR)
    assert arming.reason is Reason.GUARD_LOST


def test_holding_names_its_cause_and_ready_names_what_is_in_the_way() -> None:
    arming = arming_in(HOLDING)
    assert arming.reason is Reason.ARM_STATE_STALE
    arming.step(events(holds=(Reason.STALE_VIDEO,), **DOWN))
    assert arming.reason is Reason.STALE_VIDEO
    arming.step(events(**UP))
    assert arming.reason is None
    arming.step(events(**STALE, **UP))
    assert (arming.state, arming.reason) == (READY, Reason.ARM_STATE_STALE)


@pytest.mark.parametrize("reason", list(Reason))
def test_every_reason_tells_the_operator_what_to_do(reason: Reason) -> None:
    assert reason.label
    assert len(reason.label) <= 24
    assert reason.sentence.endswith(".")
    assert len(reason.sentence) > 20
    releases = ("release the trigger", "trigger released", "confirm", "start the session again")
    assert any(word in reason.sentence for word in releases)
    assert ("confirm" in reason.sentence or "session" in reason.sentence) == reason.is_fault


def test_labels_are_distinct_and_arm_errors_carry_their_code() -> None:
    assert len({reason.label for reason in Reason}) == len(Reason)
    assert describe_arm_error(24) == "C24 (joint speed or singularity)"
    assert describe_arm_error(97) == "C97"
