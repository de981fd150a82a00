"""A wizard as it is started from a terminal: the question, and Ctrl-C at any time."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calibration.weights.ratings import RatingFolder, simulate_panel

pytestmark = pytest.mark.waiting

ROOT = Path(__file__).resolve().parents[2]
TIMEOUT_S = 90.0
QUESTION = "Write it?"


class Terminal:
    """A terminal in which a command was started."""

    def __init__(self, *command):
        self._end, other = pty.openpty()
        command = [sys.executable, str(ROOT / "run_tams.py"), *command]
        streams = dict.fromkeys(("stdin", "stdout", "stderr"), other)
        self.process = subprocess.Popen(command, start_new_session=True, **streams)
        os.close(other)
        self.text = ""

    def wait_for(self, words):
        give_up_s = time.monotonic() + TIMEOUT_S
        while words not in self.text:
            assert time.monotonic() < give_up_s, self.text
            self._read()

    def type(self, answer):
        os.write(self._end, answer.encode())

    def interrupt(self):
        self.process.send_signal(signal.SIGINT)

    def end(self):
        """The exit code; all that was said is in `text`."""
        give_up_s = time.monotonic() + TIMEOUT_S
        while self._read():
            assert time.monotonic() < give_up_s, self.text
        code = self.process.wait(TIMEOUT_S)
        os.close(self._end)
        return code

    def _read(self):
        """False once the other end is closed."""
        if not select.select([self._end], [], [], 0.2)[0]:
            return True
        try:
            data = os.read(self._end, 65536)
        except OSError:  # how Linux tells that the other end is closed
            return False
        self.text += data.decode(errors="replace").replace("\r\n", "\n")
        return bool(data)


@pytest.fixture
def start(config_path):
    """Starts a wizard in a terminal; none is left behind."""
    started = []

    def begin(*options):
        started.append(Terminal("calibrate", *options, "--config", str(config_path)))
        return started[-1]

    yield begin
    for terminal in started:
        if terminal.process.poll() is None:
            terminal.process.kill()
            terminal.process.wait()


def test_ctrl_c_at_the_question_keeps_the_result_out_of_force(config_path, start):
    ratings = RatingFolder(config_path.parent / "ratings", ("eih", "gt", "gs"))
    for sheet in simulate_panel(("eih", "gt", "gs"), seed=1):
        ratings.open(sheet.rater, simulated=True)
        for answer in sheet.answers:
            ratings.add(sheet.rater, answer)
    terminal = start("weights", "--ratings", str(ratings.path), "--accept-unfounded")
    terminal.wait_for(QUESTION)
    terminal.type("perhaps\n")
    terminal.wait_for("Please answer y or n.")
    terminal.interrupt()
    assert terminal.end() == 130
    assert "Kept, but not in force:" in terminal.text
    assert "tams: interrupted" in terminal.text
    files = sorted((config_path.parent / "calibration/lab").iterdir())
    assert [file.suffix for file in files] == [".png", ".yaml"]  # and no in-force.yaml


@pytest.mark.verify
def test_ctrl_c_before_there_is_a_result_writes_nothing(config_path, start):
    terminal = start("frame", "--no-buttons", "--sim", "--rounds", "6")
    terminal.wait_for("Round 1.")
    terminal.interrupt()
    assert terminal.end() == 130
    assert "Traceback" not in terminal.text
    assert "[dim]" not in terminal.text
    assert "tams: interrupted" in terminal.text
    assert not (config_path.parent / "calibration").exists()
