"""Helper processes, from both sides."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from tams_app.errors import HelperError
from tams_app.runtime.process import PROJECT_DIRECTORY, HelperProcess
from tams_app.runtime.realtime import use_fifo, use_ordinary

pytestmark = pytest.mark.waiting


def helper(tmp_path, behaviour):
    specification = {"behaviour": behaviour, "number": 42}
    return HelperProcess("echo", "tests.echo_helper", specification, tmp_path)


def test_a_helper_tells_when_it_is_ready_survives_ctrl_c_and_ends_when_asked(tmp_path):
    process = helper(tmp_path, "serve")
    process.start()
    assert process.wait_ready() == {"number": 42}
    assert os.getsid(process.pid) != os.getsid(0)  # nor does Ctrl-Z or a hang-up reach it
    os.kill(process.pid, signal.SIGINT)
    assert process.exit_code is None
    process.stop()
    process.stop()
    assert process.exit_code == 0


def test_a_helper_loads_its_modules_as_an_ordinary_process_whoever_starts_it(tmp_path):
    process = helper(tmp_path, "tell policy")
    if use_fifo(1).startswith("other"):
        pytest.skip("no permission for real-time priorities")
    try:
        process.start()
        assert os.sched_getscheduler(0) == os.SCHED_FIFO
    finally:
        use_ordinary()
    assert process.wait_ready() == {"policy": os.SCHED_OTHER}
    process.stop()


def test_a_helper_hears_what_it_is_told_and_telling_one_that_has_ended_harms_nobody(tmp_path):
    process = helper(tmp_path, "listen")
    process.send(fps=10)
    process.start()
    process.wait_ready()
    process.send(fps=7.5)
    assert process.wait_ready() == {"fps": 7.5}
    process._process.kill()
    process._process.wait()
    process.send(fps=5)
    process.stop()
    process.send(fps=5)


def test_a_helper_that_stands_still_holds_up_nothing_and_gets_the_last_once_it_goes_on(tmp_path):
    process = helper(tmp_path, "listen for the last")
    process.start()
    process.wait_ready()
    os.kill(process.pid, signal.SIGSTOP)
    for number in range(10_000):
        process.send(number=number, last=number == 9_999)
    os.kill(process.pid, signal.SIGCONT)
    while process._unsent:
        process.resend()
    assert process.wait_ready() == {"number": 9_999, "last": True}
    process.stop()


@pytest.mark.parametrize(
    ("behaviour", "told"),
    [("fail", "port 7 is in use"), ("die", r"echo could not start; see .*echo\.log")],
)
def test_a_helper_that_cannot_work_says_why_or_where_its_log_is(tmp_path, behaviour, told):
    process = helper(tmp_path, behaviour)
    process.start()
    with pytest.raises(HelperError, match=told):
        process.wait_ready()
    process.stop()


def test_a_helper_that_ignores_everything_is_killed(tmp_path):
    process = helper(tmp_path, "stubborn")
    process.start()
    process.wait_ready()
    process.stop(timeout_s=0.6)
    assert process.exit_code == -signal.SIGKILL


def gone_within_s(patience_s, pid):
    """Whether process `pid`, an orphan by now, ends; a zombie has ended too."""
    give_up_s = time.monotonic() + patience_s
    while time.monotonic() < give_up_s:
        try:
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.01)
    return False


def test_a_helper_ends_when_its_session_is_killed():
    lines = (
        "import os, signal",
        "from tams_app.runtime.process import HelperProcess",
        "specification = {'behaviour': 'serve', 'number': 1}",
        "h = HelperProcess('echo', 'tests.echo_helper', specification, None)",
        "h.start(); h.wait_ready(); print(h.pid, flush=True)",
        "os.kill(os.getpid(), signal.SIGKILL)",
    )
    parent = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        cwd=PROJECT_DIRECTORY,
        capture_output=True,
        timeout=30,
        check=False,
    )
    assert parent.returncode == -signal.SIGKILL
    assert gone_within_s(30.0, int(parent.stdout))
