"""Keys at a remote desktop or terminal move no real arm, unless the configuration allows it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tams_app.config import CONFIG_DIRECTORY, Config, load_config
from tams_app.errors import SetupError
from tams_app.station import seat
from tams_app.station.seat import remote_seat, require_local_seat, x_extensions
from tests.faces.window.xvfb import virtual_screen

pytestmark = pytest.mark.untimed

LOCAL = {"DISPLAY": ":0", "XDG_SESSION_ID": "1"}


def found(environment: dict[str, str], session: str = "no", *extensions: bytes) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(seat, "logind_session", lambda: session)
        patch.setattr(seat, "x_extensions", lambda _: extensions)
        return remote_seat(environment)


def lite6(**overrides: object) -> Config:
    return load_config(CONFIG_DIRECTORY / "lite6.yaml", dict(overrides))


def test_a_seat_at_this_computer_is_local() -> None:
    assert found(LOCAL) == found(LOCAL, "") == found({}) == ""
    assert found({"WAYLAND_DISPLAY": "wayland-0", "DISPLAY": ":0"}, "no", b"XWAYLAND") == ""


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("SSH_CONNECTION", "10.0.0.2 51000 10.0.0.1 22"),
        ("SSH_TTY", "/dev/pts/3"),
        ("XRDP_SESSION", "1"),
        ("VNCDESKTOP", "lab:1"),
        ("DISPLAY", "localhost:10.0"),  # what `ssh -X` sets
        ("DISPLAY", "192.0.2.7:0"),
    ],
)
def test_ssh_rdp_vnc_and_the_x_server_of_another_computer_are_remote(name: str, value: str) -> None:
    assert value in found(LOCAL | {name: value}) or name in found(LOCAL | {name: value})


def test_what_logind_and_the_x_server_say_of_themselves_counts() -> None:
    assert "logind" in found(LOCAL, "yes")
    assert "VNC" in found(LOCAL, "no", b"VNC-EXTENSION")
    assert "Wayland" in found(LOCAL, "no", b"XWAYLAND")
    assert "GDK_BACKEND" in found(LOCAL | {"WAYLAND_DISPLAY": "w", "GDK_BACKEND": "x11"})


def test_a_real_arm_is_refused_in_one_sentence_and_a_simulated_one_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.2 51000 10.0.0.1 22")
    with pytest.raises(SetupError, match=r"remote \(SSH_CONNECTION is set\).*remote_seat"):
        require_local_seat(lite6(), True, "the terminal")
    require_local_seat(lite6(**{"controller.remote_seat": True}), True, "the terminal")
    require_local_seat(load_config(None), False, "the terminal")


def test_a_plain_x_server_says_nothing_of_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with virtual_screen(tmp_path, monkeypatch) as screen:
        assert x_extensions(screen.display) == ()
    assert x_extensions(":4711") == ()


def test_what_logind_says_is_asked_of_the_session_of_this_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "loginctl"
    program.write_text('#!/bin/sh\n[ "$2" = 7 ] && echo yes\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    monkeypatch.setenv("XDG_SESSION_ID", "7")
    monkeypatch.setattr(seat.Path, "read_text", lambda _: "0::/user.slice/some.service")
    assert seat.logind_session() == "yes"
    monkeypatch.setattr(seat.Path, "read_text", lambda _: "0::/user-0.slice/session-8.scope")
    assert seat.logind_session() == ""
