"""A part fails in its thread: the arm is stopped, the session ends and says why."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hw.remote_controller import RemoteController
from hw.sim.world.rig_memory import SimCamera
from tams_app.console.app import run_session
from tams_app.errors import TamsError
from tams_app.policy.allocation import Policy
from tams_app.recording import SessionLog, mcap_log
from tams_app.recording.mcap_log import McapLog
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.applications import Observed, only_log, rig_config

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]


@pytest.fixture
def observed(monkeypatch: pytest.MonkeyPatch) -> Observed:
    return Observed(monkeypatch)


def failing(
    observed: Observed, method: Callable[..., Any], failure: BaseException
) -> Callable[..., Any]:
    """`method`, which works until the arm moves."""

    def instead(*arguments: Any, **keywords: Any) -> Any:
        if observed.moving.is_set():
            raise failure
        return method(*arguments, **keywords)

    return instead


def ends_with(observed: Observed, out: Path, sentence: str) -> None:
    """Run a session; it must stop the arm and fail with `sentence` and exit code 1."""
    with pytest.raises(TamsError) as caught:
        run_session(rig_config(out), arm_at_once=True)
    assert observed.moving.is_set(), "the arm moved before"
    assert observed.arm_stopped
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 1


def ended_in_fault(observed: Observed) -> None:
    """The control loop itself went on to the end, in fault and without a motion."""
    last = observed.outputs[-1]
    assert last.arming is ArmingState.FAULT
    assert last.reason is Reason.SESSION_FAILED
    first = next(n for n, each in enumerate(observed.outputs) if each.arming is ArmingState.FAULT)
    after = observed.outputs[first:]
    assert after[0].stop
    assert all(each.arming is ArmingState.FAULT for each in after)
    assert not any(each.twist is not None and not each.twist.is_zero for each in after)


def is_reported(out: Path, sentence: str) -> None:
    """The log can be read to its end and says why it ends."""
    log = only_log(out)
    assert not log.truncated
    assert any(note.level == "error" and sentence in note.text for note in log.notes)
    assert log.ticks[-1].reason == Reason.SESSION_FAILED.label
    assert log.ticks[-1].twist.is_zero
    assert log.outcome is not None
    assert not log.outcome.completed


def has_what_was_written_before(log: SessionLog) -> bool:
    """Ticks until shortly before the failure, and none of what came after it."""
    armings = {tick.arming for tick in log.ticks}
    return ArmingState.READY in armings and ArmingState.FAULT not in armings


def test_an_exception_in_the_policy_thread(
    observed: Observed, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failure = ZeroDivisionError("no budget at all")
    monkeypatch.setattr(Policy, "step", failing(observed, Policy.step, failure))
    ends_with(observed, tmp_path, "policy: ZeroDivisionError('no budget at all')")
    ended_in_fault(observed)
    is_reported(tmp_path, "ZeroDivisionError")


def test_no_memory_left_in_a_camera_thread(
    observed: Observed, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    whole = SimCamera.next_frame
    fails = failing(observed, whole, MemoryError())

    def next_frame(camera: SimCamera, timeout_s: float) -> Any:
        return (fails if camera.view == "gt" else whole)(camera, timeout_s)

    monkeypatch.setattr(SimCamera, "next_frame", next_frame)
    ends_with(observed, tmp_path, "capture-gt: MemoryError()")
    ended_in_fault(observed)
    is_reported(tmp_path, "capture-gt: MemoryError()")


def test_the_recorders_thread_dies(
    observed: Observed, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failure = RuntimeError("the codec broke")
    monkeypatch.setattr(McapLog, "write", failing(observed, McapLog.write, failure))
    ends_with(observed, tmp_path, "recorder: RuntimeError('the codec broke')")
    ended_in_fault(observed)
    assert has_what_was_written_before(only_log(tmp_path))


def test_the_disk_is_nearly_full(
    observed: Observed, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The recorder keeps a reserve, so that the log is finished in order."""
    whole = mcap_log.free_mb
    monkeypatch.setattr(
        mcap_log, "free_mb", lambda path: 0.0 if observed.moving.is_set() else whole(path)
    )
    ends_with(observed, tmp_path, "recording ended because only 0 MB are free")
    ended_in_fault(observed)
    log = only_log(tmp_path)
    assert not log.truncated
    assert has_what_was_written_before(log)


def test_the_control_thread_itself_dies(
    observed: Observed, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failure = OSError("the runtime's library crashed")
    sample = failing(observed, RemoteController.sample, failure)
    monkeypatch.setattr(RemoteController, "sample", sample)
    ends_with(observed, tmp_path, "control: OSError")
    log = only_log(tmp_path)
    assert not log.truncated
    assert any("control: OSError" in note.text for note in log.notes)
