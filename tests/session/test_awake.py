"""The lock that keeps the computer awake: held with the session, and missed when it is not."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import psutil
import pytest

from tams_app.session.awake import INHIBIT, KeptAwake
from tests.hw.lite6.controller_rig import until

pytestmark = pytest.mark.waiting


def inhibitor(folder: Path, body: str) -> list[str]:
    """A program in place of systemd-inhibit, with its arguments."""
    program = folder / "systemd-inhibit"
    program.write_text(f"#!/bin/sh\necho $$ > {folder}/pid\n{body}\n")
    program.chmod(0o755)
    return [str(program), *INHIBIT[1:]]


GRANTS = 'while [ "${1#--}" != "$1" ]; do shift; done\nexec "$@"'


def test_the_lock_is_held_until_the_end_and_nothing_is_said(tmp_path: Path) -> None:
    said: list[str] = []
    awake = KeptAwake(said.append, inhibitor(tmp_path, GRANTS))
    awake.start()
    assert until(lambda: (tmp_path / "pid").exists() and bool((tmp_path / "pid").read_text()))
    pid = int((tmp_path / "pid").read_text())
    assert psutil.pid_exists(pid)
    awake.close()
    awake.close()
    assert not psutil.pid_exists(pid)
    assert said == []


@pytest.mark.parametrize("body", ["exit 1", "exec <&-; sleep 0.2; exit 1", "sleep 0.2; exit 1"])
def test_a_refused_lock_is_told(tmp_path: Path, body: str) -> None:
    said: list[str] = []
    awake = KeptAwake(said.append, inhibitor(tmp_path, body))
    awake.start()
    assert until(lambda: said != [])
    assert "logind refuses" in said[0]
    awake.close()


def test_a_lock_that_is_lost_on_the_way_is_told(tmp_path: Path) -> None:
    said: list[str] = []
    awake = KeptAwake(said.append, inhibitor(tmp_path, GRANTS))
    awake.start()
    assert until(lambda: awake.held)
    os.kill(int((tmp_path / "pid").read_text()), signal.SIGKILL)
    assert until(lambda: said != [])
    assert "the lock was lost" in said[0]
    awake.close()
    assert len(said) == 1


def test_a_computer_without_the_program_is_told_so(tmp_path: Path) -> None:
    said: list[str] = []
    awake = KeptAwake(said.append, [str(tmp_path / "nothing")])
    awake.start()
    awake.close()
    assert len(said) == 1
    assert "systemd-inhibit is not there" in said[0]
