"""The Lite 6 driver beyond the arm's contract: set-up, time-outs, lost connections, its traces."""

from __future__ import annotations

import math
import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import hw.lite6.setup
from hw.arms import session_boundary
from hw.lite6.arm import Lite6
from hw.lite6.protocol import ErrorCode, Mode, Register, ReplyBit, State
from hw.lite6.sender import Outbox, Work
from hw.lite6.setup import Lite6Connection
from hw.sim.controller.model import ReportKind
from hw.sim.controller.server import ControllerServer
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.errors import DeviceError
from tams_app.records import LinkFault, Twist
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.realtime import use_fifo, use_ordinary
from tests.hw.lite6.controller_rig import WITHIN_S, ControllerRig, controller, until

# A quarter of the shortest time in which a reply must come here.
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=60)]

SIDEWAYS = Twist(np.array([0.0, 0.05, 0.0]), np.zeros(3))


@pytest.fixture
def quick_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Setting up waits for the 5 Hz report several times; most tests need not."""
    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))


@pytest.fixture
def rig(quick_reports: None) -> Iterator[ControllerRig]:
    with controller() as made:
        yield made


def make_arm(config: ArmConfig) -> Lite6:
    return Lite6(config, MonotonicClock())


@pytest.fixture
def unconnected(rig: ControllerRig) -> Iterator[Lite6]:
    boundary = session_boundary(ArmConfig(), LimitsConfig())
    made = Lite6(rig.config(reply_timeout_s=0.25), MonotonicClock(), 120.0, boundary)
    yield made
    made.close()


@pytest.fixture
def arm(rig: ControllerRig, unconnected: Lite6) -> Lite6:
    """Connected and enabled."""
    rig.model.settings.self_collision_check = False
    unconnected.connect()
    unconnected.enable()
    return unconnected


def send_until(arm: Lite6, failure: str) -> bool:
    def failed() -> bool:
        arm.send_twist(SIDEWAYS)
        return failure in arm.link().failure

    return until(failed)


# --- setting up ---------------------------------------------------------------------------------


def test_the_controller_holds_the_configured_settings_once_enabled(
    rig: ControllerRig, arm: Lite6
) -> None:
    config, settings = ArmConfig(), rig.model.settings
    assert settings.self_collision_check
    wanted = [*config.tcp_offset_mm_deg[:3], *map(math.radians, config.tcp_offset_mm_deg[3:])]
    np.testing.assert_allclose(settings.tcp_offset, wanted, rtol=1e-6)
    np.testing.assert_allclose(
        settings.load, [config.tcp_load_kg, *config.tcp_load_centre_mm], rtol=1e-6
    )
    assert settings.collision_sensitivity == config.collision_sensitivity


def test_connecting_first_stops_what_was_left_moving_and_never_makes_the_arm_ready(
    rig: ControllerRig, unconnected: Lite6
) -> None:
    rig.make_ready()  # another program left the motors on
    with rig.server.lock:
        rig.model.move_joints(tuple(joint + 0.5 for joint in rig.model.joints), 0.1, 1.0)
    changes = record_changes(rig)
    unconnected.connect()
    stop = (Register.SET_STATE, bytes([State.STOPPED]))
    assert changes[0] == stop  # before anything else
    assert {change for change in changes if change[0] == Register.SET_STATE} == {stop}
    assert rig.stopped
    assert not rig.model.moving


def test_an_empty_address_is_one_sentence_with_the_address() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        arm = make_arm(ArmConfig(control_port=port))
        with pytest.raises(DeviceError, match=rf"No arm answers at 127\.0\.0\.1:{port}"):
            arm.connect()
        arm.close()


def test_a_peer_that_accepts_but_does_not_answer_is_told_apart() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        arm = make_arm(ArmConfig(control_port=silent.getsockname()[1]))
        with pytest.raises(DeviceError, match="does not answer"):
            arm.connect()
        arm.close()


def test_an_arm_that_does_not_acknowledge_the_first_stop_is_refused_in_a_sentence(
    rig: ControllerRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hw.lite6.setup, "STOP_TIMEOUT_S", 0.1)  # before the first attempt ends

    def silent_from_the_stop_on(register: int, _: bytes) -> None:
        if register == Register.SET_STATE:
            rig.server.reply_delay_s = 30.0

    rig.intercept(silent_from_the_stop_on)
    arm = make_arm(rig.config(reply_timeout_s=1.0))
    with pytest.raises(DeviceError, match="does not acknowledge a stop"):
        arm.connect()
    arm.close()


def test_reports_at_the_controllers_true_rates_will_do() -> None:
    with controller() as rig:
        arm = make_arm(rig.config())
        arm.connect()
        arm.enable()
        arm.send_twist(SIDEWAYS)
        assert until(lambda: arm.link().sent == 1)
        assert arm.link().failure == ""
        arm.close()


def test_two_arms_with_ports_of_their_own_live_in_one_process(rig: ControllerRig) -> None:
    with controller() as other:
        arms = [make_arm(rig.config()), make_arm(other.config())]
        for arm in arms:
            arm.connect()
            arm.enable()
        arms[1].set_gripper(True)
        assert until(lambda: other.model.settings.tool_outputs != 0)
        assert rig.model.settings.tool_outputs == 0
        for arm in arms:
            assert arm.link().failure == ""
            arm.close()


# --- leaving no traces --------------------------------------------------------------------------


def test_connecting_prints_nothing_and_leaves_other_sockets_time_outs_alone(
    capfd: pytest.CaptureFixture[str], arm: Lite6
) -> None:
    arm.stop()
    arm.clear_errors()
    arm.enable()
    arm.send_twist(SIDEWAYS)
    assert until(lambda: arm.link().sent > 0)
    assert socket.getdefaulttimeout() is None
    assert capfd.readouterr() == ("", "")


def test_closing_ends_every_thread(rig: ControllerRig) -> None:
    def threads() -> set[threading.Thread]:
        served = "arm-controller-"  # the controller's, not the driver's
        return {t for t in threading.enumerate() if not t.name.startswith(served)}

    before = threads()
    arm = make_arm(rig.config())
    arm.connect()
    assert len(threads() - before) >= 4
    arm.close()
    assert threads() == before


def test_the_threads_on_a_commands_way_can_be_given_real_time(arm: Lite6) -> None:
    ids = arm.realtime_thread_ids
    assert set(ids) == {"arm-sender", "arm-report", "arm-stop"}
    tasks = {int(task.name) for task in Path("/proc/self/task").iterdir()}
    assert set(ids.values()) <= tasks
    assert len(set(ids.values())) == 3


# --- the command link ---------------------------------------------------------------------------


def test_the_link_counts_and_times_acknowledged_commands(arm: Lite6) -> None:
    before = arm.link()
    arm.send_twist(SIDEWAYS)
    assert until(lambda: arm.link().sent == before.sent + 1)
    assert until(lambda: arm.link().acknowledged_ns > before.acknowledged_ns)
    assert arm.link().round_trip_ns > 0


def test_an_idle_link_is_kept_alive(arm: Lite6) -> None:
    before = arm.link()
    assert until(lambda: arm.link().acknowledged_ns > before.acknowledged_ns)
    assert arm.link().sent == before.sent


def test_replies_later_than_a_period_are_counted_as_slow_but_are_no_failure(
    rig: ControllerRig,
) -> None:
    arm = make_arm(rig.config(reply_timeout_s=1.0))
    arm.connect()
    arm.enable()
    rig.server.reply_delay_s = 0.02
    slow = arm.link().slow
    arm.send_twist(SIDEWAYS)
    assert until(lambda: arm.link().slow > slow)
    assert arm.link().failure == ""
    rig.server.reply_delay_s = 0.0
    arm.close()


def test_a_stop_does_not_wait_for_a_hanging_command(rig: ControllerRig, arm: Lite6) -> None:
    before = arm.link()
    rig.server.reply_delay_s = 30.0
    arm.send_twist(SIDEWAYS)
    assert until(lambda: arm.link().sent > before.sent)
    arm.stop()
    assert until(lambda: rig.stopped)
    answer_again(rig)


def test_an_idle_arm_that_no_longer_answers_is_lost(rig: ControllerRig, arm: Lite6) -> None:
    rig.server.reply_delay_s = 30.0
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    answer_again(rig)


def test_closing_when_the_arm_has_gone_closes_all_and_says_that_no_stop_was_acknowledged(
    rig: ControllerRig, arm: Lite6
) -> None:
    rig.server.close()
    assert until(lambda: arm.link().failure != "")
    arm.stop()
    with pytest.raises(DeviceError, match="did not acknowledge its last stop"):
        arm.close()
    names = {thread.name for thread in threading.enumerate()}
    assert not names & {"arm-sender", "arm-report", "arm-stop"}
    arm.close()


Move = Callable[[Lite6], None]


def move(arm: Lite6) -> None:
    state = arm.state()
    assert state is not None
    arm.begin_move_to_joints([*state.joints[:5], state.joints[5] + 0.1], 0.5)


@pytest.mark.parametrize("act", [lambda arm: arm.enable(), move], ids=["enabling", "moving"])
def test_an_arm_that_is_not_seen_to_get_ready_is_stopped_again(
    rig: ControllerRig, arm: Lite6, monkeypatch: pytest.MonkeyPatch, act: Move
) -> None:
    monkeypatch.setattr(hw.lite6.setup, "REPORT_TIMEOUT_S", 0.3)
    arm.stop()
    assert until(lambda: rig.stopped)

    def go_silent_once_ready(register: int, payload: bytes) -> None:
        if (register, payload) == (Register.SET_STATE, bytes([0])):
            rig.model.reports_frozen = True

    rig.intercept(go_silent_once_ready)
    changes = record_changes(rig)
    with pytest.raises(DeviceError):
        act(arm)
    assert (Register.SET_STATE, bytes([0])) in changes  # it was ready
    assert until(lambda: rig.stopped)


def test_an_arm_that_refuses_a_move_is_stopped_again(rig: ControllerRig, arm: Lite6) -> None:
    arm.stop()
    assert until(lambda: rig.stopped)
    answer_to(rig, Register.MOVE_JOINT, bytes([ReplyBit.INVALID]))
    with pytest.raises(DeviceError, match="the move"):
        move(arm)
    assert until(lambda: rig.stopped)


def test_a_stop_while_enabling_wins(rig: ControllerRig, arm: Lite6) -> None:
    arm.stop()

    def stop_meanwhile(register: int, _: bytes) -> None:
        if register == Register.MOTION_ENABLE:
            arm.stop()

    rig.intercept(stop_meanwhile)
    with pytest.raises(DeviceError, match="stopped meanwhile"):
        arm.enable()
    assert until(lambda: rig.stopped)
    sent = arm.link().sent
    arm.send_twist(SIDEWAYS)
    assert arm.link().sent == sent


def test_a_stop_while_enabling_is_the_reason_that_is_told_however_late_it_works(
    rig: ControllerRig, arm: Lite6, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped_after_the_mode(_connection: object, _mode: Mode) -> None:
        arm.stop()
        raise DeviceError("The arm did not get ready.")

    monkeypatch.setattr(Lite6Connection, "make_ready", stopped_after_the_mode)
    with pytest.raises(DeviceError, match="stopped meanwhile"):
        arm.enable()
    assert until(lambda: rig.stopped)


def test_a_gripper_command_is_not_repeated_after_an_emergency_stop(
    rig: ControllerRig, arm: Lite6
) -> None:
    def pressed(register: int, _: bytes) -> None:
        if register == Register.TOOL_GPIO_WRITE and not rig.model.error_code:
            arm.stop()
            rig.model.raise_error(ErrorCode.EMERGENCY_STOP)

    before = arm.link().sent
    rig.intercept(pressed)
    arm.set_gripper(True)
    assert until(lambda: rig.model.error_code != 0)
    acknowledged_ns = arm.link().acknowledged_ns
    assert until(lambda: arm.link().acknowledged_ns > acknowledged_ns)  # a keep-alive after it
    assert arm.link().sent == before + 1


def test_what_was_taken_from_the_outbox_before_a_stop_is_not_sent_after_it(
    rig: ControllerRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = make_arm(rig.config())
    taken = threading.Event()
    take = Outbox.take

    def take_and_stop(outbox: Outbox, timeout_s: float) -> Work:
        work = take(outbox, timeout_s)
        if work.motion is not None:
            arm.stop()
            taken.set()
        return work

    monkeypatch.setattr(Outbox, "take", take_and_stop)
    arm.connect()
    arm.enable()
    changes = record_changes(rig)
    arm.send_twist(SIDEWAYS)
    assert taken.wait(WITHIN_S)
    acknowledged_ns = arm.link().acknowledged_ns
    assert until(lambda: arm.link().acknowledged_ns > acknowledged_ns)  # the sender goes on
    arm.close()
    assert arm.link().sent == 0
    assert {register for register, _ in changes} == {Register.SET_STATE}


def test_the_end_of_the_sender_is_a_lost_link_until_errors_are_cleared(
    arm: Lite6, monkeypatch: pytest.MonkeyPatch
) -> None:
    def break_down(outbox: Outbox, timeout_s: float) -> Work:
        raise RuntimeError("worn out")

    with monkeypatch.context() as broken:
        broken.setattr(Outbox, "take", break_down)
        assert until(lambda: "arm-sender ended (worn out)" in arm.link().failure)
        assert arm.link().fault is LinkFault.LOST
        with pytest.raises(DeviceError, match="worn out"):
            arm.enable()
    arm.clear_errors()
    assert arm.link().fault is LinkFault.NONE
    arm.enable()
    assert moves(arm)


# --- a link made anew -----------------------------------------------------------------------------


def test_a_restarted_controller_is_taken_up_again_with_all_settings_when_errors_are_cleared(
    rig: ControllerRig, arm: Lite6
) -> None:
    arm.set_gripper(True)
    assert until(lambda: gripper(arm) is True)
    rig.restart()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    assert until(lambda: gripper(arm) is None)
    assert not rig.model.settings.fence
    arm.clear_errors()
    settings, config = rig.model.settings, ArmConfig()
    assert settings.fence
    np.testing.assert_allclose(settings.tcp_offset[:3], config.tcp_offset_mm_deg[:3])
    assert arm.link().failure == ""
    assert rig.stopped
    assert gripper(arm) is None
    arm.enable()
    np.testing.assert_allclose(settings.load[0], config.tcp_load_kg)
    assert moves(arm)


def test_until_the_controller_is_back_the_link_stays_lost_and_nothing_breaks(
    rig: ControllerRig, arm: Lite6
) -> None:
    ports = rig.server.ports
    rig.server.close()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    for _ in range(2):
        with pytest.raises(DeviceError, match="No arm answers"):
            arm.clear_errors()
        assert arm.link().fault is LinkFault.LOST
        assert arm.state() is not None
        arm.stop()
        arm.send_twist(SIDEWAYS)
        with pytest.raises(DeviceError):
            arm.enable()
    rig.server = ControllerServer(rig.model, control_port=ports.control, report_port=ports.report)
    rig.server.start()
    arm.clear_errors()
    assert arm.link().fault is LinkFault.NONE


def test_connecting_again_mends_a_lost_link_too_and_clears_no_error(
    rig: ControllerRig, arm: Lite6
) -> None:
    rig.restart()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    with rig.server.lock:
        rig.model.raise_error(ErrorCode.COLLISION)
    with pytest.raises(DeviceError, match="C31"):
        arm.connect()
    assert rig.model.error_code == ErrorCode.COLLISION
    with rig.server.lock:
        rig.model.clean_error()
    assert until(lambda: (state := arm.state()) is not None and state.fault is None)
    arm.connect()
    arm.enable()
    assert moves(arm)


def test_state_link_and_stop_do_not_wait_for_a_link_that_is_made_anew(
    rig: ControllerRig, arm: Lite6
) -> None:
    rig.server.drop_connections()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    connecting, go_on = threading.Event(), threading.Event()

    def linger(register: int, _: bytes) -> None:
        if register == Register.GET_VERSION:
            connecting.set()
            go_on.wait(WITHIN_S)

    rig.intercept(linger)
    clearing = threading.Thread(target=arm.clear_errors)
    clearing.start()
    assert connecting.wait(WITHIN_S)
    assert arm.link().fault is LinkFault.LOST
    assert arm.state() is not None
    arm.stop()
    assert clearing.is_alive()
    go_on.set()
    clearing.join()
    assert arm.link().fault is LinkFault.NONE
    assert rig.stopped


def test_a_link_whose_renewal_was_not_configured_stays_lost_and_the_next_one_is(
    rig: ControllerRig, arm: Lite6, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[LinkFault] = []

    def fail(connection: Lite6Connection) -> None:
        seen.append(arm.link().fault)
        raise DeviceError("The arm did not take its settings.")

    rig.restart()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    with monkeypatch.context() as broken:
        broken.setattr(Lite6Connection, "configure", fail)
        with pytest.raises(DeviceError, match="its settings"):
            arm.clear_errors()
    assert seen == [LinkFault.LOST]
    assert arm.link().fault is LinkFault.LOST
    assert rig.model.settings.tcp_offset[2] == 0.0
    arm.clear_errors()
    assert rig.model.settings.tcp_offset[2] == ArmConfig().tcp_offset_mm_deg[2]
    assert arm.link().fault is LinkFault.NONE


def test_a_stop_goes_to_the_link_that_is_being_made_too(
    rig: ControllerRig, arm: Lite6, monkeypatch: pytest.MonkeyPatch
) -> None:
    configure = Lite6Connection.configure
    stops: list[bool] = []

    def stop_meanwhile(connection: Lite6Connection) -> None:
        rig.make_ready()
        arm.stop()
        stops.append(connection.stop.pending or rig.stopped)
        configure(connection)

    rig.server.drop_connections()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    monkeypatch.setattr(Lite6Connection, "configure", stop_meanwhile)
    arm.clear_errors()
    assert stops == [True]
    assert rig.stopped


def test_an_arm_that_is_closed_while_its_link_is_made_anew_stays_closed(
    rig: ControllerRig, arm: Lite6, monkeypatch: pytest.MonkeyPatch
) -> None:
    configure = Lite6Connection.configure

    def close_meanwhile(connection: Lite6Connection) -> None:
        arm.close()
        configure(connection)

    rig.server.drop_connections()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    monkeypatch.setattr(Lite6Connection, "configure", close_meanwhile)
    with pytest.raises(DeviceError, match="not connected"):
        arm.clear_errors()
    assert arm.state() is None


def test_frozen_reports_need_a_new_connection_and_get_it(rig: ControllerRig, arm: Lite6) -> None:
    rig.model.reports_frozen = True
    assert until(lambda: arm_is_silent(arm))
    threads = arm.realtime_thread_ids
    with pytest.raises(DeviceError, match="reports"):
        arm.clear_errors()
    rig.model.reports_frozen = False
    arm.clear_errors()
    assert arm.link().fault is LinkFault.NONE
    assert arm.realtime_thread_ids["arm-report"] != threads["arm-report"]


def arm_is_silent(arm: Lite6) -> bool:
    state = arm.state()
    return state is not None and MonotonicClock().now_ns() - state.received_ns > 1_100_000_000


def test_a_new_links_threads_are_scheduled_as_the_old_ones_were(
    rig: ControllerRig, arm: Lite6
) -> None:
    if use_fifo(1).startswith("other"):
        pytest.skip("real-time scheduling is not permitted here")
    use_ordinary()
    for thread_id in arm.realtime_thread_ids.values():
        use_fifo(3, thread_id)
    rig.server.drop_connections()
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    arm.clear_errors()
    for thread_id in arm.realtime_thread_ids.values():
        assert os.sched_getscheduler(thread_id) == os.SCHED_FIFO
        assert os.sched_getparam(thread_id).sched_priority == 3


# --- the controller's boundary --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ignored", "told"),
    [
        (Register.SET_TCP_OFFSET, "TCP offset"),
        (Register.SET_BOUNDARY, "safety boundary"),
        (Register.SET_FENCE, "safety boundary"),
    ],
)
def test_a_setting_that_does_not_come_back_is_refused(
    rig: ControllerRig,
    unconnected: Lite6,
    monkeypatch: pytest.MonkeyPatch,
    ignored: Register,
    told: str,
) -> None:
    monkeypatch.setattr(hw.lite6.setup, "REPORT_TIMEOUT_S", 0.5)
    answer_to(rig, ignored, bytes(1))
    with pytest.raises(DeviceError, match=told):
        unconnected.connect()


def test_an_arm_whose_boundary_was_removed_is_not_enabled(
    rig: ControllerRig, unconnected: Lite6
) -> None:
    unconnected.connect()
    with rig.server.lock:
        rig.model.settings.fence = False
    with pytest.raises(DeviceError, match="safety boundary"):
        unconnected.enable()
    assert until(lambda: rig.stopped)


def test_a_boundary_that_another_program_removes_is_a_failure_until_it_is_set_again(
    rig: ControllerRig, arm: Lite6
) -> None:
    with rig.server.lock:
        rig.model.settings.fence = False
    assert until(lambda: "safety boundary" in arm.link().failure)
    assert arm.link().fault is LinkFault.REFUSED
    sent = arm.link().sent
    arm.send_twist(SIDEWAYS)
    arm.clear_errors()
    assert (arm.link().failure, arm.link().sent) == ("", sent)
    assert rig.model.settings.fence
    arm.enable()
    assert moves(arm)


def gripper(arm: Lite6) -> bool | None:
    state = arm.state()
    assert state is not None
    return state.gripper_closed


def moves(arm: Lite6) -> bool:
    """Whether the arm follows commands."""
    before = arm.state()
    assert before is not None

    def moved() -> bool:
        arm.send_twist(SIDEWAYS)
        state = arm.state()
        return state is not None and bool(state.tcp.position[1] > before.tcp.position[1] + 0.001)

    return until(moved)


def test_the_control_loop_never_waits_for_a_reply(rig: ControllerRig) -> None:
    arm = make_arm(rig.config(reply_timeout_s=1.0))
    arm.connect()
    arm.enable()
    before = arm.link()
    rig.server.reply_delay_s = 30.0
    arm.send_twist(SIDEWAYS)
    assert until(lambda: arm.link().sent > before.sent)  # and now the sender waits for its reply
    for _ in range(100):
        arm.send_twist(SIDEWAYS)
        arm.set_gripper(True)
        arm.state()
    link = arm.link()
    assert (link.acknowledged_ns, link.failure) == (before.acknowledged_ns, "")
    assert until(lambda: arm.link().fault is LinkFault.LOST)
    assert arm.link().slow >= before.slow + 2
    answer_again(rig)
    arm.close()


def test_an_error_is_known_from_a_reply_before_a_report_tells_of_it(
    rig: ControllerRig, arm: Lite6
) -> None:
    with rig.server.lock:
        rig.model.reports_frozen = True
        rig.model.raise_error(31)
    assert send_until(arm, "C31")
    state = arm.state()
    assert state is not None
    assert state.fault is not None
    assert state.fault.code == 31


def answer_again(rig: ControllerRig) -> None:
    """End a delay of the replies, also of those that are under way."""
    rig.server.reply_delay_s = 0.0
    rig.server.drop_connections()


def record_changes(rig: ControllerRig) -> list[tuple[int, bytes]]:
    """The requests from now on that change something, in order, while they come in."""
    changes: list[tuple[int, bytes]] = []
    queries = {
        Register.GET_VERSION,
        Register.GET_STATE,
        Register.GET_ERROR,
        Register.TOOL_GPIO_READ,
    }

    def record(register: int, payload: bytes) -> None:
        if register not in queries:
            changes.append((register, payload))

    rig.intercept(record)
    return changes


def answer_to(rig: ControllerRig, register: Register, reply: bytes) -> None:
    """Let the controller answer this to a register, and do nothing."""
    rig.intercept(lambda asked, _: reply if asked == register else None)
