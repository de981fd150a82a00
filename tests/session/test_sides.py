"""What the two sides tell each other, in memory: samples, requests, pulses, sentences, the end."""

from __future__ import annotations

from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tams_app.config import Config, load_config
from tams_app.link.channel import (
    HAND_BYTES,
    LONGEST_MESSAGE_BYTES,
    STATE_BYTES,
    message_bytes,
)
from tams_app.link.messages import (
    OPERATOR_FOLDER_FACT,
    HandMessage,
    SessionDescription,
    StateMessage,
    decode,
    encode,
)
from tams_app.presses import PressCounter
from tams_app.records import (
    Allocation,
    ControllerSample,
    ControllerStatus,
    EpisodeRequest,
    HandHeard,
    Haptic,
    LinkHealth,
    Newest,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    PinnedView,
    Placed,
    StateHeard,
    SteeredBy,
    StopRecord,
)
from tams_app.robot.control import TOO_LONG_AGO, Signals, SteadyVideo
from tams_app.robot.ground import Ground
from tams_app.robot.linked_operator import LinkedOperator, welcome_of
from tams_app.robot.status import StatusBoard
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.mailbox import Sentences
from tams_app.station.linked_robot import LinkedRobot, Requests, RobotFrames
from tams_app.station.robot_call import follow
from tams_app.teleop.hands import hand_of
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import SentFrame, SentFrames
from tams_app.video.core.repair import RepairRule
from tests.robot.test_control import HeldController
from tests.robot.test_parts import after, output
from tests.session.exchange import MemoryGateway, MemoryJournal, called

pytestmark = pytest.mark.untimed

CONFIG = load_config()
PERIOD_NS = NS_PER_S // 120
VIEWS = CONFIG.video.views


class MenuController(HeldController):
    """A controller whose menu button the test presses, too."""

    def __init__(self) -> None:
        super().__init__()
        self.menu = False
        self._counter = PressCounter()

    def sample(self, now_ns: int) -> ControllerSample:
        presses = self._counter.update(0.0, False, False, self.menu)
        return replace(super().sample(now_ns), menu=self.menu, presses=presses)


class Sides:
    """Both sides, whose clocks differ by half an hour."""

    def __init__(self, delay_ms: int = 20, config: Config = CONFIG) -> None:
        self.robot_clock, self.operator_clock = VirtualClock(2000 * NS_PER_S), VirtualClock()
        self.there = MemoryGateway(self.robot_clock)
        self.here = MemoryGateway(self.operator_clock)
        self.there.other, self.here.other = self.here, self.there
        self.there.delay_ns = self.here.delay_ns = delay_ms * NS_PER_MS
        self.robot_log = MemoryJournal(self.robot_clock)
        self.operator_log = MemoryJournal(self.operator_clock)
        self.signals, self.requests = Signals(), Requests()
        self.shown = dict.fromkeys(VIEWS, SteeredBy())
        self.newest = Newest([PhaseChange(0, Phase.REACH, "start")])
        self.board, self.config = StatusBoard(config, self.newest), config
        video: Any = SimpleNamespace(rule=RepairRule(True, 60, 300.0), feedback=True)
        self.welcome = encode(welcome_of(config, video, "20260101-120000-robot"))
        self.sent = {view: SentFrames() for view in VIEWS}
        ground = Ground(config, self.robot_clock, self.robot_log, self.signals)
        self.sentences = Sentences()  # for the operator
        gateway: Any = self.there
        self.robot = LinkedOperator(ground, gateway, self.sent, self.sentences)
        self.controller = self.robot.take_controller()
        receivers: Any = SimpleNamespace(steered_by=lambda view: self.shown[view])
        self.operator = LinkedRobot(
            self.operator_clock,
            called(self.here, "sim"),
            self.requests,
            self.operator_log,
            receivers,
            RobotFrames(VIEWS),
        )
        self.hand = self.operator.controller = MenuController()
        self.sample: ControllerSample | None = None
        self.confirmed = self.stopped = 0
        self.decided = output(ArmingState.DISARMED)

    def run(self, seconds: float, *, robot: bool = True) -> None:
        for _ in range(round(seconds * 120)):
            for clock in (self.robot_clock, self.operator_clock):
                clock.advance_ns(PERIOD_NS)
            self.operator.step()
            if not robot:
                continue
            now_ns = self.robot_clock.now_ns()
            self.sample = self.controller.sample(now_ns)
            pending = self.signals.take(now_ns)
            self.confirmed += pending.confirm
            if pending.late_confirm:
                self.robot_log.note("warning", TOO_LONG_AGO)
            self.stopped += pending.estop
            over = after(self.decided, now_ns)
            self.newest.put(over)
            self.robot.receive(over)
            if self.robot.wants_state(now_ns):
                hand = hand_of(self.config)
                self.robot.show(self.board.state(now_ns, 1.0, SteadyVideo(), hand))

    def cut(self, is_cut: bool) -> None:
        self.here.cut = self.there.cut = is_cut

    def reconnect(self) -> None:
        """As after a new handshake."""
        self.here.session = self.there.session = self.here.session + 1
        self.cut(False)


@pytest.fixture
def sides() -> Sides:
    """Both sides, which have been connected for a second."""
    sides = Sides()
    sides.run(1.0)
    return sides


def test_a_sample_arrives_with_its_times_on_the_robots_clock():
    sides = Sides()
    sides.hand.trigger = 0.7
    sides.run(1.0)
    sample, now_ns = sides.sample, sides.robot_clock.now_ns()
    assert sample.status is ControllerStatus.OK
    assert sample.trigger == 0.7
    assert now_ns - 2 * PERIOD_NS <= sample.pose_ns <= now_ns
    heard = sides.robot_log.of(HandHeard)
    assert [one.refusal for one in heard[-60:]] == [""] * 60


def test_before_it_has_heard_an_echo_nothing_counts():
    sides = Sides()
    sides.there.cut = True  # the operator's side hears nothing
    sides.run(1.0)
    assert sides.sample.status is ControllerStatus.LINK_LOST
    assert {one.refusal for one in sides.robot_log.of(HandHeard)} == {"without an echo"}


def test_a_lost_link_is_told_as_one_and_found_again(sides: Sides):
    sides.cut(True)
    sides.run(0.3)
    assert sides.sample.status is ControllerStatus.LINK_GAP
    sides.run(3.0)
    assert sides.sample.status is ControllerStatus.LINK_LOST
    sides.cut(False)
    sides.run(0.3)
    assert sides.sample.status is ControllerStatus.OK


def test_each_request_about_episodes_arrives_once_and_a_lost_link_makes_no_second_press() -> None:
    sides = Sides()
    sides.requests.episode(EpisodeRequest.FAILURE)  # before anyone is connected
    sides.run(0.5)
    assert sides.signals.episodes() == []
    sides.requests.episode(EpisodeRequest.NEXT)
    sides.requests.episode(EpisodeRequest.SUCCESS)
    sides.run(1.0)
    assert sides.signals.episodes() == [EpisodeRequest.NEXT, EpisodeRequest.SUCCESS]
    sides.cut(True)
    sides.requests.episode(EpisodeRequest.DISCARD)
    sides.run(1.0)
    sides.requests.episode(EpisodeRequest.DISCARD)
    sides.run(1.0)
    sides.cut(False)
    sides.run(1.0)
    assert sides.signals.episodes() == [EpisodeRequest.DISCARD]


def test_an_emergency_stop_pressed_while_nothing_arrives_stops_once_when_it_does(sides: Sides):
    sides.cut(True)
    sides.requests.estop()
    sides.run(5.0)
    assert sides.stopped == 0
    sides.cut(False)
    sides.run(1.0)
    assert sides.stopped == 1


@pytest.mark.parametrize("arming", ["ready", "engaged", "holding"])
@pytest.mark.parametrize("loss", ["lost", "in one burst"])
def test_a_click_of_the_menu_button_that_no_sample_shows_stops_an_armed_arm_once(
    arming: str, loss: str
):
    sides = Sides()
    sides.decided = output(ArmingState(arming))
    sides.run(1.0)
    if loss == "lost":
        sides.here.cut = True
    for down in (True, False):
        sides.hand.menu = down
        sides.run(0.04, robot=loss == "lost")
    sides.here.cut = False
    sides.run(1.0)
    assert sides.sample.status is ControllerStatus.OK
    assert sides.stopped == 1


def test_the_menu_button_stops_nothing_where_the_arm_is_not_armed_or_it_went_down_before():
    sides = Sides()
    sides.hand.menu = True
    sides.run(1.0)
    sides.decided = output(ArmingState.DISARMED)
    for down in (False, True, False):
        sides.hand.menu = down
        sides.run(0.1)
    sides.decided = output(ArmingState.READY)
    sides.run(1.0)
    assert sides.stopped == 0


def test_the_robots_side_names_whose_key_its_operator_has_and_when_it_is_revoked():
    sides = Sides()
    there = sides.there
    there.event = msgspec.structs.replace(there.event, operator="kim")
    sides.run(0.2)
    assert "an operator is connected, with the key of kim" in sides.robot_log.notes
    there.event = msgspec.structs.replace(there.event, left=True, revoked=True)
    sides.run(0.1)
    revoked = "the key of kim was revoked: its operator is let go"
    assert sides.robot_log.notes.count(revoked) == 1
    assert sides.sample is not None
    assert sides.sample.status is not ControllerStatus.OK


@pytest.mark.parametrize("connected", [False, True])
def test_the_robots_terminal_alone_says_once_who_called_in_vain(connected: bool):
    sides = Sides()
    there = sides.there
    sides.robot_log._show = sides.sentences.note  # as the session forwards what it shows
    refusal = "192.0.2.7:4000 is not answered: the key of who calls is not accepted here"
    there.event = msgspec.structs.replace(there.event, refusal=refusal, connected=connected)
    sides.run(0.5)
    assert sides.robot_log.notes.count(refusal) == 1
    there.event = msgspec.structs.replace(there.event, connected=True)
    sides.sentences.note("for the operator")
    sides.run(0.5)
    assert "for the operator" in sides.operator_log.notes
    assert refusal not in sides.operator_log.notes


@pytest.mark.parametrize(
    "told",
    [b"", b"../..", b".hidden", b"/etc", b"a b", b"a\n", b"\xff\xfe", b"\x1b[2J", b"n" * 101],
)
def test_the_robots_log_names_the_folder_of_the_operators_unless_it_can_be_none(told: bytes):
    sides = Sides()
    there = sides.there
    there.event = msgspec.structs.replace(there.event, introduction=told)
    sides.run(0.1)
    assert OPERATOR_FOLDER_FACT not in sides.robot_log.facts
    there.event = msgspec.structs.replace(there.event, introduction=b"20260101-120000-operate")
    sides.run(0.1)
    there.event = msgspec.structs.replace(there.event, introduction=told)
    sides.run(0.1)
    assert sides.robot_log.facts[OPERATOR_FOLDER_FACT] == "20260101-120000-operate"


def test_how_long_a_datagram_is_tells_neither_the_arming_state_nor_the_reason():
    sizes = set()
    for reason in (None, *Reason):
        for state in ArmingState:
            sides = Sides()
            sides.run(0.1)
            told = output(state) if reason is None else output(state, reason)
            sides.decided = replace(told, detail="d" * 150)
            sides.hand.menu = sides.hand.a = state is ArmingState.READY
            sides.there.sent.clear()
            sides.here.sent.clear()
            sides.run(0.02)
            for gateway in (sides.there, sides.here):
                robots = gateway is sides.there
                least_bytes = STATE_BYTES if robots else HAND_BYTES
                sizes.add((robots, message_bytes(len(gateway.sent[-1]), least_bytes)))
    assert len(sizes) == 2


def test_no_message_with_all_its_sentences_is_too_long_for_a_datagram(sides: Sides):
    fault = output(ArmingState.FAULT, Reason.ARM_ERROR)
    sides.decided = replace(fault, detail="d" * 400)
    for _ in range(5):
        sides.sentences.note("ü" * 5000)
    sides.run(0.01)
    sides.robot.end("r" * 400, failed=True)
    sizes = [len(content) for content in sides.there.sent]
    assert max(sizes) <= LONGEST_MESSAGE_BYTES
    told = decode(sides.there.sent[-1], StateMessage)
    assert told.failed
    assert told.notes
    assert told.ended.startswith("rrr")


def test_a_confirmation_arms_only_while_it_is_fresh(sides: Sides):
    sides.requests.confirm(sides.operator_clock.now_ns())
    sides.run(0.5)
    assert sides.confirmed == 1
    sides.cut(True)
    sides.requests.confirm(sides.operator_clock.now_ns())
    sides.run(2.5)
    sides.cut(False)
    sides.run(1.0)
    assert sides.confirmed == 1
    assert TOO_LONG_AGO in sides.robot_log.notes


def test_a_confirmation_that_waits_for_a_robots_side_that_stands_still_ages_meanwhile(
    sides: Sides,
) -> None:
    sides.requests.confirm(sides.operator_clock.now_ns() - 1_500 * NS_PER_MS)
    sides.run(0.9, robot=False)  # fresh when it arrives, and 2.4 s old when it is taken in
    sides.run(0.5)
    assert sides.confirmed == 0
    assert sides.robot_log.notes.count(TOO_LONG_AGO) == 1


def test_what_a_confirmation_waited_for_at_the_operators_side_counts_towards_its_age():
    sides = Sides()
    sides.run(2.0)
    sides.requests.confirm(sides.operator_clock.now_ns() - 1_700 * NS_PER_MS)
    sides.cut(True)
    sides.run(0.5)
    sides.cut(False)
    sides.run(1.0)
    assert sides.confirmed == 0
    sides.requests.confirm(sides.operator_clock.now_ns() - 1_700 * NS_PER_MS)
    sides.run(0.5)
    assert sides.confirmed == 1


@pytest.mark.parametrize("acknowledged", [True, False])
def test_a_stop_is_asked_for_until_it_is_acknowledged_also_in_the_next_session_of_the_link(
    sides: Sides, acknowledged: bool
):
    sides.cut(not acknowledged)
    sides.requests.estop()
    sides.run(0.5)
    sides.cut(True)
    sides.run(3.0)
    sides.reconnect()
    sides.run(1.0)
    assert sides.stopped == 1


def test_where_the_operators_side_fails_the_hand_is_put_down_at_once():
    sides = Sides()
    sides.hand.trigger = 1.0
    sides.run(1.0)
    assert sides.sample.trigger == 1.0
    sides.requests.fail()
    sides.run(0.05)
    assert sides.sample.status is ControllerStatus.DISCONNECTED
    assert sides.sample.trigger == 0.0


def test_each_pulse_is_felt_once(sides: Sides):
    sides.controller.pulse(Haptic.ENGAGE)
    sides.run(0.5)
    sides.controller.pulse(Haptic.FAULT)
    sides.run(0.5)
    assert sides.hand.pulses == [Haptic.ENGAGE, Haptic.FAULT]


def test_each_sentence_is_read_once_although_messages_are_lost(sides: Sides):
    sides.sentences.note("fault, link lost")
    sides.there.cut = True
    sides.run(5.0)
    sides.there.cut = False
    sides.run(0.5)
    sides.sentences.note("ready")
    sides.run(2.0)
    notes = sides.operator_log.notes
    told = [note for note in notes if not note.startswith("connected to the robot at ")]
    assert told == ["fault, link lost", "ready"]


def test_the_operators_side_knows_what_the_uplink_carries(sides: Sides):
    state = sides.operator.state.state
    assert [state.views[view].sent_kbps for view in VIEWS] == [None] * 3
    assert (state.budget_kbps, state.link_kbps) == (None, None)
    now_ns = sides.robot_clock.now_ns()
    left_ns = now_ns + 12 * NS_PER_MS
    for view, fate in zip(VIEWS, (PacketFate.LOST, *[PacketFate.DELIVERED] * 2), strict=True):
        packet = PacketRecord(view, PacketKind.MEDIA, 0, 1000, now_ns, left_ns, left_ns, fate)
        sides.board.packets([packet] * 50)
    targets = dict.fromkeys(VIEWS, 1000)
    allocation = Allocation(now_ns, Phase.REACH, float("inf"), 3400.0, targets)
    sides.newest.put(allocation)
    sides.board.receive(allocation)
    sides.run(1.0)
    state = sides.operator.state.state
    assert [state.views[view].sent_kbps for view in VIEWS] == [400.0] * 3
    assert [state.views[view].target_kbps for view in VIEWS] == [1000.0] * 3
    assert (state.link_kbps, state.queue_ms, state.loss) == (1200.0, 12.0, 1 / 3)
    assert (state.budget_kbps, state.estimate_kbps) == (3400.0, None), "without limit"


def test_the_robots_side_knows_which_frames_are_shown():
    sides = Sides()
    start_ns = sides.robot_clock.now_ns()
    for index in range(2):
        sides.sent[VIEWS[1]].add(SentFrame(index, start_ns + index * NS_PER_S, 0))
    sides.shown[VIEWS[1]] = SteeredBy(90_000, 1, is_damaged=True)
    sides.run(1.5)
    seen = SteeredBy(90_000, start_ns + NS_PER_S, is_damaged=True)
    assert [sides.robot.steered_by(view) for view in VIEWS] == [SteeredBy(), seen, SteeredBy()]
    now_ns = sides.robot_clock.now_ns()
    assert sides.robot.age_ns(VIEWS[1], now_ns) == now_ns - start_ns - NS_PER_S
    sides.shown[VIEWS[1]] = SteeredBy()
    sides.reconnect()
    sides.run(1.0)
    assert sides.robot.steered_by(VIEWS[1]).index is None, "another operator sees other frames"
    assert not sides.robot.is_damaged(VIEWS[1])
    assert sides.robot.age_ns(VIEWS[1], now_ns) == now_ns - start_ns - NS_PER_S, "it gets older"


def test_the_operators_side_is_told_why_the_session_ended(sides: Sides):
    assert not sides.operator.state.state.placed
    sides.robot.receive(Placed(0, placed=True))  # which ends the session before another state
    sides.robot.end("the trial is over", failed=False)
    sides.run(0.5, robot=False)
    assert sides.operator.state.ended == "the trial is over"
    assert sides.operator.state.state.placed
    assert not sides.operator.state.failed
    assert sides.there.farewells == 1


def test_bytes_that_are_no_message_change_nothing_but_a_count(sides: Sides):
    for content in (b"", b"\x90", b"\xc1", bytes(900)):
        sides.there.arrive(sides.robot_clock.now_ns(), 1, content)
        sides.here.arrive(sides.operator_clock.now_ns(), 1, content)
    sides.run(0.1)
    assert sides.sample.status is ControllerStatus.OK
    assert sides.controller.refused["not understood"] == 4


def test_numbers_beyond_all_clocks_and_counts_change_nothing_but_a_count(sides: Sides):
    """Of one who has the key: their stamps would end in records, figures and other languages."""
    told = sides.operator._hand

    def odd(sample: ControllerSample) -> HandMessage:
        return msgspec.structs.replace(
            told(sample), sent_ns=-(2**63), pose_ns=-(2**63), echo_heard_ns=2**64 - 1
        )

    sides.operator._hand = odd
    sides.run(0.2)
    sides.operator._hand = told
    sides.run(0.3)
    assert sides.controller.refused["not understood"] >= 20
    assert sides.sample.status is ControllerStatus.OK
    for record in sides.robot_log.records:
        if isinstance(record, HandHeard | LinkHealth):
            numbers = [n for n in asdict(record).values() if isinstance(n, int)]
            assert max(map(abs, numbers)) < 2**62


@pytest.mark.parametrize("there_ms", [1, 20, 90])
def test_both_sides_know_the_clocks_difference_to_within_what_they_say(there_ms: int):
    sides = Sides()
    sides.here.delay_ns = there_ms * NS_PER_MS
    truth_ns = sides.robot_clock.now_ns() - sides.operator_clock.now_ns()
    sides.run(2.0)
    robot, operator = (log.of(LinkHealth)[-1] for log in (sides.robot_log, sides.operator_log))
    assert abs(operator.offset_ns - truth_ns) <= operator.uncertainty_ns
    assert abs(robot.offset_ns + truth_ns) <= robot.uncertainty_ns
    assert operator.uncertainty_ns <= (there_ms + 20 + 20) * NS_PER_MS
    assert sides.operator_log.of(StateHeard)


def test_the_welcome_says_what_receivers_must_know():
    welcome = decode(Sides().welcome, SessionDescription)
    assert welcome.video["views"] == list(VIEWS)
    assert welcome.repair["latency_ms"] == 60
    assert welcome.feedback
    robot = load_config(overrides={"limits.radius_max_mm": 400.0, "limits.floor_mm": 9.0})
    told = decode(Sides(config=robot).welcome, SessionDescription)
    followed = follow(told, CONFIG).limits
    assert (followed.radius_max_mm, followed.floor_mm) == (400.0, 9.0)
    assert followed.max_speed_mm_s == CONFIG.limits.max_speed_mm_s


def test_each_side_knows_what_the_other_has_to_tell_the_operator():
    sides = Sides()
    for _ in range(2):  # until it is known, and then
        assert (sides.robot.hand, sides.robot.is_simulated) == ("sim", True)
        sides.run(0.5)
    sides.newest.put(StopRecord("stale video", 0, 1))
    for hand in ("openvr", "keyboard"):
        sides.operator._driven_with = hand
        sides.run(0.5)
        assert (sides.robot.hand, sides.robot.is_simulated) == (hand, False)
    assert sides.operator.state.state.last_stop == "stale video"
    assert sides.operator.state.state.lasting == ""
    sides.operator._driven_with = "a glove"
    sides.run(0.5)
    assert sides.robot.hand == "keyboard", "of a hand that is not known there are no words"


def test_the_primary_view_is_the_one_of_the_robot_s_weights():
    weights = {phase: dict(row) for phase, row in CONFIG.policy.weights.matrix.items()}
    seen = set()
    for view in VIEWS:
        weights["REACH"] = {name: 0.8 if name == view else 0.1 for name in VIEWS}
        sides = Sides(config=load_config(overrides={"policy.weights.matrix": weights}))
        sides.run(0.5)
        seen.add((view, sides.operator.state.state.primary_view))
    assert seen == {(view, view) for view in VIEWS}


def test_a_simulated_operator_moves_no_real_arm():
    rig = CONFIG.rig.model_copy(update={"enabled": False})
    sides = Sides(config=CONFIG.model_copy(update={"rig": rig}))
    sides.requests.confirm(sides.operator_clock.now_ns())
    sides.run(1.0)
    assert sides.sample.status is ControllerStatus.LINK_LOST
    assert sides.confirmed == 0
    assert sum("no real arm" in note for note in sides.robot_log.notes) == 1


# --- suspended computers --------------------------------------------------------------------------


def test_what_was_sent_before_the_robots_computer_slept_counts_for_nothing(sides: Sides):
    """It lies in the socket, and is heard in the first instant after: our clock stood still."""
    sides.requests.confirm(sides.operator_clock.now_ns())
    sides.run(2 / 120, robot=False)  # on their way
    heard = len(sides.robot_log.of(HandHeard))
    sides.robot.on_wake(sides.robot_clock.now_ns())
    sides.run(1 / 120)
    assert sides.sample.status is ControllerStatus.LINK_LOST
    sides.run(0.03)
    assert {one.refusal for one in sides.robot_log.of(HandHeard)[heard:]} == {"without an echo"}
    sides.run(0.2)
    assert sides.sample.status is ControllerStatus.OK
    assert sides.confirmed == 0


def test_an_operators_computer_that_slept_sends_nothing_of_before(sides: Sides):
    sides.hand.trigger = 1.0
    sides.run(0.1)
    assert sides.sample.trigger == 1.0
    sides.requests.confirm(sides.operator_clock.now_ns())
    sides.operator_clock.suspend_ns(3600 * NS_PER_S)
    statuses = []
    for _ in range(24):
        sides.run(1 / 120)
        statuses.append(sides.sample.status)
    first = statuses.index(ControllerStatus.LINK_LOST)
    assert first <= 3, "as soon as a message has got there"
    assert set(statuses[first:]) == {ControllerStatus.LINK_LOST}
    sides.run(0.2)
    assert sides.sample.status is ControllerStatus.OK
    assert sides.confirmed == 0
    assert any("suspended" in text for text in sides.operator_log.notes)


def test_a_pin_goes_to_the_robots_side_and_ends_when_it_is_let_go_or_another_operator_comes():
    sides = Sides()
    sides.run(0.2)
    assert sides.signals.pinned == ""
    sides.requests.pinned = VIEWS[2]
    sides.run(0.2)
    assert sides.signals.pinned == VIEWS[2]
    sides.cut(True)
    sides.requests.pinned = ""
    sides.run(0.2)
    assert sides.signals.pinned == VIEWS[2]
    sides.cut(False)
    sides.run(0.2)
    assert sides.signals.pinned == ""
    sides.requests.pinned = VIEWS[0]
    sides.run(0.2)
    sides.signals.pinned = VIEWS[1]  # of whom was there before
    sides.requests.pinned = ""
    sides.reconnect()
    sides.run(0.2)
    assert sides.signals.pinned == ""


def test_what_is_pinned_and_shown_is_not_taken_from_a_message_that_was_overtaken():
    sides = Sides()
    start_ns = sides.robot_clock.now_ns()
    for index in range(2):
        sides.sent[VIEWS[1]].add(SentFrame(index, start_ns + index * NS_PER_S, 0))
    sides.requests.pinned = VIEWS[2]
    sides.shown[VIEWS[1]] = SteeredBy(0, 1)
    sides.run(1.0)
    late = sides.here.sent[-1]
    sides.requests.pinned = VIEWS[0]
    sides.shown[VIEWS[1]] = SteeredBy(90_000, 1, is_damaged=True)
    sides.run(0.1)
    sides.cut(True)
    sides.run(0.05)
    sides.there.arrive(sides.robot_clock.now_ns(), 1, late)
    sides.run(1 / 120)
    assert sides.controller.refused["overtaken"] == 1
    assert sides.signals.pinned == VIEWS[0]
    seen = sides.robot.steered_by(VIEWS[1])
    assert (seen.index, seen.is_damaged) == (90_000, True)


@pytest.mark.parametrize("place", [-1, 3, 2**61])
def test_a_place_where_no_view_is_pins_nothing(place: int):
    sides = Sides()
    sides.operator._places = {"strange": place}
    sides.requests.pinned = "strange"
    sides.signals.pinned = VIEWS[1]
    sides.run(0.2)
    assert sides.sample.status is ControllerStatus.OK
    assert sides.signals.pinned == ""


def test_the_state_tells_the_operators_side_which_view_is_primary_since_it_is_pinned():
    sides = Sides()
    for pinned, primary in (("", "gt"), ("eih", "eih")):
        sides.newest.put(PinnedView(0, pinned))
        sides.run(0.2)
        state = sides.operator.state.state
        assert (state.primary_view, state.is_pinned) == (primary, bool(pinned))
