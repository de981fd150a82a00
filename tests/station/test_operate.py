"""How the operator's session begins, or does not: with real gateways on loopback."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import psutil
import pytest

from tams_app.config import Config, load_config
from tams_app.errors import TamsError
from tams_app.faces.session_face import facts_of
from tams_app.faces.silence import as_known, silence_of
from tams_app.faces.terminal.line import status_words
from tams_app.link.gateway_client import Endpoint, Gateway, LinkEvent
from tams_app.link.keys import new_key
from tams_app.link.messages import PROTOCOL, SessionDescription, StateMessage, decode, encode
from tams_app.records import LatencyState, Outcome, SessionState, ShownFrame, SteeredBy
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.runtime.parts import Ending
from tams_app.session.operate import operate
from tams_app.session.session import Outset
from tams_app.station.fresh_video import Displays
from tams_app.station.linked_robot import Requests
from tams_app.station.operator_side import OperatorSide
from tams_app.station.receivers import Receivers
from tams_app.station.robot_call import RobotCall, call_robot
from tams_app.units import NS_PER_MS
from tams_app.video.core.repair import RepairRule
from tests.free_port import free_port
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.waiting

STATE = StateMessage(
    sent_ns=1,
    echo_ns=0,
    echo_heard_ns=0,
    state=SessionState(t_s=0.0, arming="ready", phase="REACH", primary_view="eih"),
    first_capture_ns=(),
    haptics=0,
    haptic="",
    confirms=0,
    stops=0,
    noted=0,
    notes=(),
    ended="",
    failed=False,
)


def simulated(**changes: object) -> Config:
    return load_config(None, {"headless": True, "rig.operator.kind": "seeing", **changes})


def welcome(**changes: object) -> bytes:
    config = load_config()
    fields: dict[str, object] = {
        "protocol": PROTOCOL,
        "version": "9.9",
        "session": "a",
        "name": "robot",
        "strategy": "tams",
        "network": "none",
        "seed": 0,
        "feedback": True,
        "simulated": True,
        "video": config.video.model_dump(mode="json"),
        "repair": asdict(RepairRule(True, 60, 300.0)),
        "hand_rotation": config.hand.rotation,
        "workspace": {},
        "driving": {},
        "stopped_after_ms": 350.0,
    }
    return encode(SessionDescription(**{**fields, **changes}))


@pytest.fixture
def key(tmp_path: Path) -> Path:
    new_key(tmp_path / "key")
    return tmp_path / "key"


@pytest.fixture
def endpoint(key: Path) -> Endpoint:
    return Endpoint("127.0.0.1", free_port(socket.SOCK_DGRAM), key)


@pytest.fixture
def robot(endpoint: Endpoint, tmp_path: Path) -> Iterator[Callable[[bytes], None]]:
    gateways: list[Gateway] = []

    def answer(content: bytes) -> None:
        gateway = Gateway("robot", endpoint, content, tmp_path)
        gateways.append(gateway)
        gateway.launch()
        gateway.wait_ready()

    yield answer
    for gateway in gateways:
        gateway.close()


def receivers_of(config: Config, clock: VirtualClock, displays: Displays) -> Receivers:
    identify = dict.fromkeys(config.video.views, lambda _timestamp: None)
    rule = RepairRule(True, 60, 300.0)
    screen: Any = SimpleNamespace(show=lambda _shown: None)
    return Receivers(config.video, rule, True, clock, identify, screen, displays)


def test_the_robot_hears_of_no_newer_frames_while_the_operators_window_stands_still() -> None:
    clock, displays = VirtualClock(), Displays()
    receivers = receivers_of(simulated(), clock, displays)
    heard_ns = clock.now_ns()
    displays.add(lambda _view: heard_ns)
    image = np.zeros((2, 2, 3), np.uint8)

    def show(timestamp: int, whole: bool = True) -> SteeredBy:
        clock.advance_ns(NS_PER_MS)
        now_ns = clock.now_ns()
        took_ns = 3 * NS_PER_MS
        receivers._shown(
            ShownFrame("gt", timestamp, now_ns, image, timestamp, whole, now_ns - took_ns)
        )
        return receivers.steered_by("gt")

    try:
        assert show(100) == SteeredBy(), "not before the window shows it"
        heard_ns = clock.now_ns()
        assert show(101) == SteeredBy(100, 100)
        assert show(102) == SteeredBy(100, 100)
        heard_ns = clock.now_ns()
        assert show(103, whole=False) == SteeredBy(102, 102)
        heard_ns = clock.now_ns()
        assert show(104) == SteeredBy(102, 102, is_damaged=True)
        assert receivers.latency("gt") == LatencyState(3, "decoder", 3)
        assert receivers.latency("eih") is None, "nothing was shown of it"
    finally:
        receivers.close()


class Watched:
    """The operator's watch of a robot, whose link is told what to say."""

    def __init__(self, config: Config, stopped_after_ms: float, **link: Any) -> None:
        self.clock = VirtualClock()
        event = LinkEvent(True, 1, False, False, "", False, 0, "", {}, welcome())
        held = SimpleNamespace(pressed=())
        nothing = {"sample": held, "offset": None, "event": event}
        self.link: Any = SimpleNamespace(
            state_received_ns=self.clock.now_ns(), **{**nothing, **link}
        )
        told = decode(welcome(stopped_after_ms=stopped_after_ms), SessionDescription)
        self.log, self.ending = MemoryJournal(self.clock), Ending(self.clock)
        receivers: Any = SimpleNamespace(poll=lambda: "", views=lambda views, *_: views)
        self.side = OperatorSide(
            config, self.clock, receivers, self.link, told, self.log, self.ending
        )


@pytest.mark.parametrize(
    ("simulated_robot", "placed", "completed"),
    [(True, True, True), (True, False, False), (False, True, None)],
)
def test_at_the_end_it_is_known_of_a_rig_whether_the_block_was_placed(
    simulated_robot: bool, placed: bool, completed: bool | None
) -> None:
    state = SimpleNamespace(state=SimpleNamespace(placed=placed))
    watched = Watched(simulated(), 350.0, state=state)
    watched.side._welcome = decode(welcome(simulated=simulated_robot), SessionDescription)
    watched.side.finish("over", failed=False)
    assert watched.log.of(Outcome) == [Outcome(completed, None, None, None, "over")]


def test_the_link_is_lost_to_the_operator_once_the_robots_limits_have_stopped_the_arm() -> None:
    watched = Watched(simulated(), 350.0, state=object())
    watched.clock.advance_ns(340 * NS_PER_MS)
    assert not watched.side.receives_nothing()
    watched.clock.advance_ns(20 * NS_PER_MS)
    assert watched.side.receives_nothing()


def test_what_the_operator_sees_of_a_silent_robot_is_not_live() -> None:
    state = msgspec.structs.replace(STATE.state, arming="engaged", deadman=True)
    message = msgspec.structs.replace(STATE, state=state)
    watched = Watched(simulated(), 900.0, state=message)
    clock = watched.clock
    clock.advance_ns(290 * NS_PER_MS)
    assert silence_of(watched.side.state()) is None
    clock.advance_ns(110 * NS_PER_MS)
    shown = watched.side.state()
    assert silence_of(shown) == pytest.approx(0.4)
    assert "NOT LIVE for 0.4 s" in status_words(shown).live
    facts = msgspec.structs.replace(facts_of(shown, ()), reported_ns=clock.now_ns())
    known = as_known(facts, clock.now_ns())
    assert (known.state.arming, known.state.deadman) == ("not live", None)
    clock.advance_ns(600 * NS_PER_MS)
    assert "LINK LOST, NOT LIVE" in status_words(watched.side.state()).live


def test_whom_the_robot_is_lost_to_is_told_what_to_let_go_in_the_words_of_their_hand() -> None:
    config = load_config(None, {"controller.device": "keyboard"})
    watched = Watched(config, 350.0, state=None)
    assert watched.side.poll() == ""
    assert "release Shift, and wait until the link is back" in watched.log.notes[-1]


@pytest.mark.parametrize("failed", [False, True])
def test_the_robots_side_ends_ours_with_its_reason(failed: bool) -> None:
    message = msgspec.structs.replace(STATE, ended="the trial is over", failed=failed)
    watched = Watched(simulated(), 350.0, state=message)
    failure = watched.side.poll()
    if failed:
        assert failure == "the robot's side failed: the trial is over"
    else:
        assert (failure, watched.ending.end_reason) == ("", "the robot's side: the trial is over")


def test_another_session_there_is_not_ours() -> None:
    watched = Watched(simulated(), 360.0, state=None)
    assert "has begun another session" in watched.side.poll()


def start(
    endpoint: Endpoint,
    tmp_path: Path,
    config: Config | None = None,
    notify: Callable[[Outset, str], None] = lambda _outset, _text: None,
) -> str:
    """The sentence with which the session refuses to begin."""
    folder = tmp_path / "session"
    folder.mkdir()
    outset = Outset(config or simulated(), MonotonicClock(), folder, Requests())
    opening = operate(outset, endpoint, lambda text: notify(outset, text))
    with pytest.raises(TamsError) as refusal, opening:
        pass
    return str(refusal.value)


@pytest.mark.parametrize("is_real", [True, False])
def test_keys_of_a_remote_seat_are_refused_where_the_robot_there_is_real(
    robot, endpoint, tmp_path, monkeypatch, is_real
):
    """Whatever this computer's own configuration says: it is the other's arm that moves."""
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.2 51000 10.0.0.1 22")
    config = load_config(None, {"controller.device": "keyboard"})
    assert config.rig.enabled
    robot(welcome(simulated=not is_real))
    called: list[RobotCall] = []

    def call_only(*arguments: Any) -> RobotCall:
        called.append(call_robot(*arguments))
        raise TamsError("called")

    monkeypatch.setattr("tams_app.session.operate.call_robot", call_only)
    sentence = start(endpoint, tmp_path, config)
    assert ("the desktop is remote (SSH_CONNECTION is set)" in sentence) is is_real
    assert bool(called) is not is_real


OTHER_VIEWS = {**load_config().video.model_dump(mode="json"), "views": ["left", "right"]}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (welcome(simulated=False), "the robot there is real"),  # of a simulated operator
        (welcome(video=OTHER_VIEWS), "the robot's side has the views left, right"),
        (welcome(protocol=PROTOCOL + 1), "install the same"),
        (b"\x91\x01", "install the same"),
        (welcome(video={"width": "wide"}), "install the same"),
        (welcome(workspace={"floor_mm": "low"}), "install the same"),
    ],
    ids=["real", "views", "protocol", "message", "video", "workspace"],
)
def test_a_robot_that_cannot_be_followed_is_refused_in_a_sentence(
    robot, endpoint, tmp_path, content, sentence
):
    robot(content)
    assert sentence in start(endpoint, tmp_path)


def test_a_recorded_hand_which_sees_nothing_is_refused(endpoint, tmp_path):
    config = simulated(**{"rig.hand_trajectory": str(tmp_path / "session.mcap")})
    assert "a recorded hand sees nothing" in start(endpoint, tmp_path, config)


@pytest.mark.parametrize("is_there", [False, True])
def test_while_nothing_answers_or_refuses_the_key_it_says_so_and_can_be_ended(
    robot, endpoint, tmp_path, is_there
):
    if is_there:  # with a key of its own
        robot(welcome())
        new_key(tmp_path / "other")
        endpoint = Endpoint(endpoint.host, endpoint.port, tmp_path / "other")
    said: list[str] = []

    def notify(outset: Outset, text: str) -> None:
        said.append(text)
        outset.request_end("ended by SIGINT")

    assert "ended by SIGINT before the robot's side" in start(endpoint, tmp_path, notify=notify)
    assert "no answer: the call does not arrive there, or it is refused (another key or " in said[0]


def test_a_limit_counts_while_nothing_answers(endpoint, tmp_path):
    config = simulated(seconds=1.0)
    assert "for 1 s" in start(endpoint, tmp_path, config)


def test_a_gateway_that_is_killed_while_it_calls_is_noticed(endpoint, tmp_path):
    def kill(outset: Outset, text: str) -> None:
        (gateway,) = [
            child
            for child in psutil.Process().children()
            if "tams_app.link" in str(child.cmdline())
        ]
        gateway.kill()

    assert "the gateway ended unasked" in start(endpoint, tmp_path, notify=kill)
