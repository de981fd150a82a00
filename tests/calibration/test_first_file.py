"""`init`: the first configuration file, from what is plugged in and what a person answers."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from calibration import first_file
from calibration.first_file import Answers, stable_name, write_first_file
from hw.arm import FoundArm
from hw.lite6.kind import Lite6Kind
from hw.v4l2.devices import CameraInfo, CameraMode
from tams_app.cli import _main
from tams_app.config import load_config
from tams_app.config.marks import TEMPLATE, filled, unset_keys
from tams_app.console.doctor import configuration, marked_keys
from tams_app.console.findings import Finding
from tams_app.errors import ConfigError
from tests.calibration.test_terminal import Terminal
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.untimed

MJPEG = CameraMode("MJPG", True, 640, 480, (Fraction(30),))
RAW = CameraMode("YUYV", False, 640, 480, (Fraction(30),))
ONE = CameraInfo("Cam", "0123", "/dev/video0", ("/dev/v4l/by-path/a",), (MJPEG,))
TWIN = CameraInfo("Twin", "7", "/dev/video2", ("/dev/v4l/by-path/b", "/dev/v4l/by-id/b"), (RAW,))
OTHER = CameraInfo("Twin", "7", "/dev/video4", ("/dev/v4l/by-path/c",), (MJPEG,))
BARE = CameraInfo("Bare", "", "/dev/video6", (), ())
ALL = Answers(
    host="10.0.0.9", hand="keyboard", cameras=("eih=0123", "gt=/dev/v4l/by-path/b", "gs=none")
)


CAMERAS = [ONE, TWIN, OTHER]


@pytest.fixture(autouse=True)
def devices(monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm at one address, three cameras, and a keyboard alone."""

    def find(_kind: Lite6Kind, config: object) -> FoundArm:
        there = getattr(config, "host", "") == "10.0.0.9"
        return FoundArm("" if there else "no answer", "a Lite 6")

    def look(config: object) -> list[Finding]:
        return [Finding("Controller", False, "", "plug it in")]

    monkeypatch.setattr(Lite6Kind, "find", find)
    monkeypatch.setattr(first_file, "controller", look)
    monkeypatch.setattr(first_file, "list_cameras", lambda: CAMERAS)


def test_each_thing_is_asked_for_with_what_was_found(tmp_path: Path) -> None:
    path = tmp_path / "ours.yaml"
    ui = ScriptedUI(["10.0.0.8", "n", "10.0.0.9", "openvr", "left", "2", "1", "none"])
    write_first_file(ui, path, Answers())
    made = load_config(path)
    assert (made.arm.host, made.controller.device, made.controller.hand) == (
        "10.0.0.9",
        "openvr",
        "left",
    )
    assert (made.cameras["eih"].path, made.cameras["eih"].serial) == ("/dev/v4l/by-path/b", "")
    assert made.cameras["eih"].pixel_format == "raw"
    assert (made.cameras["gt"].serial, made.cameras["gt"].pixel_format) == ("0123", "mjpeg")
    told = "\n".join(ui.said)
    for words in ("no answer", "a Lite 6", "openvr: plug it in", "  1: 'Cam', serial 0123"):
        assert words in told
    assert "cameras.gs.serial" in told
    assert told.endswith(f"Next: run_tams.py doctor --config {path}")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The first file, of what the command line says."""
    written, ui = tmp_path / "first.yaml", ScriptedUI()
    write_first_file(ui, written, ALL)
    assert not ui.console.asked
    return written


def test_what_the_command_line_says_is_set_and_every_other_key_and_comment_stays(
    path: Path,
) -> None:
    made, ours = load_config(path), load_config(TEMPLATE)
    assert made.cameras["gt"].path == "/dev/v4l/by-path/b"
    assert made.cameras["gs"] == ours.cameras["gs"]
    assert made.limits == ours.limits
    left = set(unset_keys(path))
    assert set(unset_keys(TEMPLATE)) - left == {
        "arm.host",
        "cameras.eih.serial",
        "cameras.gt.serial",
    }
    text, before = path.read_text(), TEMPLATE.read_text()
    assert "# the control box, on a wire of its own" in text
    assert "# in quotes: YAML takes 0123 for a number" in text
    assert text.count("#") == before.count("#") - 1  # behind gt's serial there was the mark alone


def test_the_doctor_finds_the_file_in_order_but_for_what_is_left_to_set(path: Path) -> None:
    made = load_config(path)
    assert all(one.ok for one in configuration(made))
    place, other = marked_keys(path)(made)
    assert (place.is_broken, other.ok, other.is_broken) == (True, False, False)
    assert f"in {path} still as in our lite6.yaml" in place.fix
    for key in ("limits.box_min_mm", "limits.floor_mm", "arm.tcp_offset_mm_deg"):
        assert f"{key} (line " in place.fix
    assert "arm.tcp_load_kg (line " in other.fix
    path.write_text(path.read_text().replace("# SET", "# set"))
    assert all(one.ok for one in marked_keys(path)(made))
    assert not list(marked_keys(path)(load_config()))  # of the rig nothing is to be set


def test_a_file_that_is_there_is_never_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "ours.yaml"
    path.write_text("mine")
    assert _main(["init", str(path)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert path.read_text() == "mine"


def test_without_a_terminal_each_option_that_is_needed_is_named(tmp_path: Path) -> None:
    path = tmp_path / "ours.yaml"
    given = Answers(host="10.0.0.9", cameras=("gt=0123",))
    with pytest.raises(
        ConfigError, match=r"give --hand DEVICE .*--camera eih=…, --camera gs=…"
    ) as it:
        write_first_file(ScriptedUI(), path, given)
    assert "'Cam', serial 0123 at /dev/video0" in str(it.value)
    assert "--host" not in str(it.value)
    assert not path.exists()


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"hand": "broom"}, "controller.device: 'broom' is not one of"),
        ({"side": "both"}, "controller.hand"),
        ({"model": "lite7"}, "'lite7' is not one of lite6"),
        ({"cameras": ("eih",)}, "'eih' is not VIEW=SERIAL_OR_PATH"),
        ({"cameras": ("top=1",)}, "'top' is not one of eih, gt, gs"),
    ],
)
def test_an_answer_that_cannot_be_is_refused_and_nothing_is_written(
    tmp_path: Path, changed: dict[str, object], sentence: str
) -> None:
    path = tmp_path / "ours.yaml"
    given = replace(ALL, **changed)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=sentence):
        write_first_file(ScriptedUI(), path, given)
    assert not path.exists()


def test_a_camera_is_named_by_what_stays_the_same() -> None:
    found = [*CAMERAS, BARE]
    assert [stable_name(info, found) for info in found] == [
        "0123",
        "/dev/v4l/by-path/b",
        "/dev/v4l/by-path/c",
        "/dev/video6",
    ]


def test_a_key_that_was_set_is_not_named_though_its_mark_stayed(tmp_path: Path) -> None:
    path = tmp_path / "ours.yaml"
    path.write_text(TEMPLATE.read_text().replace("192.168.1.150 ", "192.168.1.151 "))
    assert "arm.host" not in unset_keys(path)
    path.write_text(TEMPLATE.read_text().replace("# SET: the lowest", "# the lowest"))
    assert "limits.floor_mm" in unset_keys(TEMPLATE)
    assert "limits.floor_mm" not in unset_keys(path)


def test_the_lines_are_those_of_the_keys() -> None:
    lines = TEMPLATE.read_text().splitlines()
    for key, line in unset_keys(TEMPLATE).items():
        assert lines[line - 1].strip().startswith(f"{key.rsplit('.', 1)[1]}:")


def test_values_of_several_keys_are_filled_in_at_their_places() -> None:
    text = "a:\n  b: 1  # SET\n  c: [1, 2]  # SET: two\nd: x\n"
    assert filled(text, {"a.b": ("e", "22"), "a.c": ("c", "[]")}) == (
        "a:\n  e: 22\n  c: []  # two\nd: x\n"
    )


def test_at_a_terminal_the_command_asks(tmp_path: Path) -> None:
    """The real command on a real terminal, with all but the cameras given."""
    terminal = Terminal("init", str(tmp_path / "a.yaml"), "--hand=keyboard")
    terminal.wait_for("address of its control box")
    terminal.type("\x04")  # the end of the input
    assert terminal.end() == 2
    assert not (tmp_path / "a.yaml").exists()
