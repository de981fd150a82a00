"""Every arrow of the arming table, and every arrow it does not have."""

from __future__ import annotations

import itertools

import pytest

from tams_app.teleop.hands import HANDS
from tams_app.teleop.safety import (
    CLEAR_CONSENT_NS,
    CLEARABLE,
    ENABLE_CONSENT_NS,
    Arming,
    ArmingEvents,
    ArmingState,
    Reason,
    Request,
)
from tams_app.units import NS_PER_S
from tests.teleop.arming_table import ARROWS, CAN_BE_CLEARED, Consent, Tick, Trigger, oracle

pytestmark = pytest.mark.waiting

DISARMED, READY, ENGAGED, HOLDING, FAULT = ArmingState

UP = {"released": True}
DOWN = {"pressed": True}
PRESS = {"pressed": True, "press": True}
UNKNOWN: dict[str, object] = {}  # no buttons are read: neither up nor down
STALE_HOLDS = (Reason.ARM_STATE_STALE,)
STALE = {"holds": STALE_HOLDS}
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


# --- all of them ----------------------------------------------------------------------------------

HOLDS = ((), (Reason.ARM_NOT_READY,), (Reason.STALE_VIDEO,), (Reason.ARM_NOT_READY, *STALE_HOLDS))
FAULTS = (
    (),
    (Reason.EMERGENCY_STOP,),
    (Reason.GUARD_LOST,),
    *((reason,) for reason in sorted(CAN_BE_CLEARED, key=lambda reason: reason.label)),
    (Reason.ARM_ERROR, Reason.ARM_LINK_LOST),
    (Reason.ARM_ERROR, Reason.CONTROLLER_DISCONNECTED),
)
TRIGGERS = {
    Trigger.UNKNOWN: UNKNOWN,
    Trigger.UP: UP,
    Trigger.HELD: DOWN,
    Trigger.PRESSED_NOW: PRESS,
}
TICKS = [
    Tick(*combination)
    for combination in itertools.product(
        ArmingState, Consent, Trigger, (False, True), (False, True), HOLDS, FAULTS
    )
]


def before(tick: Tick) -> Arming:
    """In the tick's state, with the consent it says."""
    arming = arming_in(tick.state)
    if tick.consent is not Consent.NONE:
        # Confirmed with the trigger up, while something still keeps it from going on.
        in_the_way = {DISARMED: {"arm_ready": False}, FAULT: {"faults": (Reason.ARM_ERROR,)}}
        if tick.state in in_the_way:
            arming.step(events(confirm=True, **in_the_way[tick.state], **UP))
    assert arming.state is tick.state
    return arming


def after(tick: Tick) -> ArmingState:
    arming = before(tick)
    longest_ns = max(ENABLE_CONSENT_NS, CLEAR_CONSENT_NS)
    arming.step(
        events(
            now_ns=NS_PER_S + (longest_ns + 1 if tick.consent is Consent.RUN_OUT else 0),
            confirm=tick.confirm,
            arm_ready=tick.arm_ready,
            holds=tick.holds,
            faults=tick.faults,
            **TRIGGERS[tick.trigger],
        )
    )
    return arming.state


@pytest.mark.parametrize("state", list(ArmingState))
def test_every_combination_of_events_does_what_the_table_says_and_nothing_else(
    state: ArmingState,
) -> None:
    ticks = [tick for tick in TICKS if tick.state is state]
    assert len(ticks) == 3 * 4 * 2 * 2 * len(HOLDS) * len(FAULTS)
    wrong = [tick for tick in ticks if after(tick) is not oracle(tick)]
    assert wrong == []


def test_no_event_at_all_leads_along_an_arrow_the_table_lacks() -> None:
    allowed = {
        (start, end) for origin, _, end in ARROWS for start in ([origin] if origin else ArmingState)
    }
    seen = {(tick.state, after(tick)) for tick in TICKS}
    assert seen - {(state, state) for state in ArmingState} == allowed - {(FAULT, FAULT)}


def test_clearing_takes_away_what_the_arm_and_its_link_report_and_nothing_else() -> None:
    assert CLEARABLE == CAN_BE_CLEARED


def test_confirming_disarmed_asks_once_to_enable_and_waits_for_the_arm() -> None:
    arming = Arming()
    assert arming.step(events(confirm=True, arm_ready=False, **UP)) is Request.ENABLE
    assert arming.step(events(arm_ready=False, **UP)) is Request.NONE
    assert arming.state is DISARMED
    arming.step(events(arm_ready=True, **DOWN))
    assert arming.state is DISARMED
    arming.step(events(arm_ready=True, **UP))
    assert arming.state is READY


@pytest.mark.parametrize(
    ("late_ns", "enabling", "clearing"), [(0, READY, DISARMED), (1, DISARMED, FAULT)]
)
def test_consent_holds_for_ten_seconds_to_enable_and_for_three_to_clear_errors(
    late_ns: int, enabling: ArmingState, clearing: ArmingState
) -> None:
    assert (ENABLE_CONSENT_NS, CLEAR_CONSENT_NS) == (10 * NS_PER_S, 3 * NS_PER_S)
    arming = Arming()
    arming.step(events(confirm=True, arm_ready=False, **UP))
    arming.step(events(now_ns=NS_PER_S + ENABLE_CONSENT_NS + late_ns, **UP))
    assert arming.state is enabling
    arming = Arming()
    arming.step(events(faults=(Reason.ARM_ERROR,), **UP))
    arming.step(events(faults=(Reason.ARM_ERROR,), confirm=True, **UP))
    arming.step(events(now_ns=NS_PER_S + CLEAR_CONSENT_NS + late_ns, **UP))
    assert arming.state is clearing


def test_consent_to_enable_waits_while_something_is_stale() -> None:
    arming = Arming()
    arming.step(events(confirm=True, arm_ready=False, **UP))
    arming.step(events(**STALE, **UP))
    assert (arming.state, arming.reason) == (DISARMED, Reason.ARM_STATE_STALE)
    arming.step(events(**UP))
    assert (arming.state, arming.reason) == (READY, None)


def test_confirming_while_something_is_stale_is_no_consent() -> None:
    arming = Arming()
    for given in (STALE, {"holds": (Reason.ARM_NOT_READY, *STALE_HOLDS)}):
        assert arming.step(events(confirm=True, arm_ready=False, **given, **UP)) is Request.NONE
    arming.step(events(**UP))
    assert arming.state is DISARMED


def test_an_arm_that_is_ready_already_is_not_enabled_again() -> None:
    assert Arming().step(events(confirm=True, **UP)) is Request.NONE


def test_what_one_operator_confirmed_does_not_arm_the_arm_for_the_next() -> None:
    arming = Arming()
    assert arming.step(events(confirm=True, arm_ready=False, **UP)) is Request.ENABLE
    arming.step(events(holds=(Reason.NO_OPERATOR,)))
    arming.step(events(**UP))
    assert arming.state is DISARMED
    arming.step(events(confirm=True, **UP))
    assert arming.state is READY


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


@pytest.mark.parametrize(
    "newcomer", [Reason.EMERGENCY_STOP, Reason.GUARD_STOPPED, Reason.CONTROLLER_DISCONNECTED]
)
def test_what_clearing_cannot_take_away_withdraws_the_consent_to_clear(newcomer: Reason) -> None:
    arming = Arming()
    arming.step(events(faults=(Reason.ARM_ERROR,), **UP))
    arming.step(events(faults=(Reason.ARM_ERROR,), confirm=True, **UP))
    assert arming.step(events(faults=(newcomer,), confirm=True, **UP)) is Request.NONE
    arming.step(events(**UP))
    assert arming.state is FAULT
    arming.step(events(confirm=True, **UP))
    assert arming.state is DISARMED


@pytest.mark.parametrize(
    "lost", [Reason.CONTROLLER_DISCONNECTED, Reason.RUNTIME_QUIT, Reason.ROLE_SWAPPED]
)
def test_a_lost_controller_must_be_back_before_a_confirmation_counts(lost: Reason) -> None:
    arming = Arming()
    arming.step(events(faults=(lost,)))
    for _ in range(3):
        assert arming.step(events(faults=(lost,), confirm=True, **UP)) is Request.NONE
    arming.step(events(**UP))
    assert (arming.state, arming.reason) == (FAULT, lost)  # the early confirmations count nothing
    arming.step(events(confirm=True, **UP))
    assert arming.state is DISARMED


def test_a_fault_says_what_must_be_gone_before_it_can_be_confirmed() -> None:
    arming = Arming()
    both = (Reason.ARM_ERROR, Reason.CONTROLLER_DISCONNECTED)
    arming.step(events(faults=(Reason.ARM_ERROR,)))
    assert arming.blocked_by is None
    arming.step(events(faults=both))
    assert (arming.reason, arming.blocked_by) == (Reason.ARM_ERROR, both[1])
    arming.step(events(faults=(Reason.ARM_ERROR,)))
    assert arming.blocked_by is None
    arming.step(events(faults=both))
    arming.step(events(confirm=True, **UP))
    assert (arming.state, arming.blocked_by, arming.reason) == (DISARMED, None, None)


def test_tripping_withdraws_every_consent() -> None:
    arming = Arming()
    arming.step(events(faults=(Reason.ARM_ERROR,), **UP))
    arming.step(events(faults=(Reason.ARM_ERROR,), confirm=True, **UP))
    arming.trip(Reason.TRAJECTORY_ERROR)
    arming.step(events(**UP))
    assert arming.state is FAULT


def test_a_fault_keeps_its_first_reason() -> None:
    arming = arming_in(FAULT)
    arming.step(events(faults=(Reason.EMERGENCY_STOP,), **UP))
    arming.trip(Reason.TRAJECTORY_ERROR)
    assert arming.reason is Reason.GUARD_LOST


def test_what_tripped_is_told_as_still_there_until_a_step_without_it() -> None:
    arming = arming_in(ENGAGED)
    arming.trip(Reason.TRAJECTORY_ERROR)
    assert (arming.state, arming.lasting) == (FAULT, Reason.TRAJECTORY_ERROR)
    arming.step(events(**UP))
    assert (arming.reason, arming.lasting) == (Reason.TRAJECTORY_ERROR, None)


def test_holding_names_its_cause_and_ready_names_what_is_in_the_way() -> None:
    arming = arming_in(HOLDING)
    assert arming.reason is Reason.ARM_STATE_STALE
    arming.step(events(holds=(Reason.STALE_VIDEO,), **DOWN))
    assert arming.reason is Reason.STALE_VIDEO
    arming.step(events(**UP))
    assert arming.reason is None
    arming.step(events(**STALE, **UP))
    assert (arming.state, arming.reason) == (READY, Reason.ARM_STATE_STALE)


@pytest.mark.parametrize("lasts", [True, False], ids=["lasting", "left"])
@pytest.mark.parametrize("reason", list(Reason))
@pytest.mark.parametrize("hand", HANDS)
def test_every_reason_tells_the_operator_what_to_do(hand: str, reason: Reason, lasts: bool) -> None:
    assert reason.label
    assert len(reason.label) <= 24
    words = HANDS[hand]
    sentence = reason.sentence(words, lasts)
    assert sentence.endswith(".")
    assert len(sentence) > 15
    assert sentence[0].isupper()
    steps = (words.release, "start the session again")
    assert any(step in sentence or step.capitalize() in sentence for step in steps)
    assert ("confirm" in sentence or "session" in sentence) == reason.is_fault
    if not lasts and reason.left != reason.lasting:
        assert "wait" not in sentence.replace(words.release, "")


@pytest.mark.parametrize("lasts", [True, False], ids=["lasting", "left"])
@pytest.mark.parametrize("reason", list(Reason))
def test_no_hand_is_told_of_what_belongs_to_another(reason: Reason, lasts: bool) -> None:
    tracked = {  # reasons that only a tracked controller has
        *(Reason.RUNTIME_QUIT, Reason.ROLE_SWAPPED, Reason.TRACKING_FRAME_CHANGED),
        *(Reason.DASHBOARD_OPEN, Reason.TRACKING_LOST, Reason.HAND_TOO_FAST),
    }
    if reason not in tracked:
        sentence = reason.sentence(HANDS["keyboard"], lasts)
        for word in ("the trigger", "headset", "SteamVR", "track"):
            assert word not in sentence
    for hand in HANDS:
        if hand != "keyboard":
            assert "keys" not in reason.sentence(HANDS[hand], lasts)


def test_labels_are_distinct() -> None:
    assert len({reason.label for reason in Reason}) == len(Reason)
