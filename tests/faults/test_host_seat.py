"""Keys at a remote seat: the application ends before it has asked a real arm for anything."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from hw.sim.controller.server import ControllerServer
from tams_app.config import CONFIG_DIRECTORY
from tests.faces.window.xvfb import virtual_screen
from tests.faults.applications import Application, until
from tests.faults.wire import Request, tapped_model

KEYBOARD, HOME = ("run", "--hand", "keyboard"), ("home",)
SSH, VNC = "SSH_CONNECTION", "VNCDESKTOP"

pytestmark = [pytest.mark.timed, pytest.mark.matrix, pytest.mark.verify, pytest.mark.timeout(300)]


@contextmanager
def started(
    folder: Path, patch: pytest.MonkeyPatch, words: tuple[str, ...], allowed: bool = False
) -> Iterator[tuple[Application, list[Request]]]:
    """The application beside a screen, and what it asks of a control box that counts as real."""
    model = tapped_model()
    server = ControllerServer(model)
    server.start()
    control, report = server.ports.control, server.ports.report
    settings = {
        "include": [str(CONFIG_DIRECTORY / "lite6.yaml")],
        "headless": False,
        "faces": ["window"],
        "rig": {},
        "arm": {"host": "127.0.0.1", "control_port": control, "report_port": report},
        "controller": {"remote_seat": allowed},
    }
    with (
        closing(server),
        virtual_screen(folder, patch),
        Application(folder, words=words, **settings) as application,
    ):
        yield application, model.wire


@pytest.mark.parametrize(("words", "sign"), [(KEYBOARD, SSH), (KEYBOARD, VNC), (HOME, SSH)])
def test_a_remote_seat_moves_no_real_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], sign: str
) -> None:
    monkeypatch.setenv(sign, "lab:1")
    with started(tmp_path, monkeypatch, words) as (application, asked):
        code, sentence = application.ends()
    assert (code, sentence.count("\n"), asked) == (1, 1, [])
    assert f" is remote ({sign} is set)" in sentence
    assert not list(application.out.glob("*"))


def test_one_that_the_configuration_allows_reaches_the_same_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SSH, "lab:1")
    with started(tmp_path, monkeypatch, KEYBOARD, allowed=True) as (_, asked):
        until(lambda: bool(asked), "the arm to be asked")
