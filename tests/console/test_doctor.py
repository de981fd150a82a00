"""The doctor: each need is looked at, each lack named with what mends it."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tams_app import gst
from tams_app.config import CONFIG_DIRECTORY, Config, load_config
from tams_app.console import devices, doctor, findings
from tams_app.console.findings import Check, Finding
from tams_app.faces.window import toolkit
from tams_app.printing import Console
from tams_app.runtime.process import PROJECT_DIRECTORY
from tests.further import further

pytestmark = pytest.mark.waiting


def config(**overrides: Any) -> Config:
    return load_config(None, {key.replace("__", "."): value for key, value in overrides.items()})


def examine(*looked_at: Check) -> tuple[int, list[str]]:
    output = io.StringIO()
    code = doctor.run_doctor(config(), looked_at, console=Console(file=output, width=200))
    return code, output.getvalue().splitlines()


def test_a_program_reads_the_findings_as_one_list() -> None:
    tc = Finding("tc", False, "", "apt-get install iproute2, which [also] has ip", essential=False)
    x264 = Finding("GStreamer element x264enc", False, "none of " + "many " * 30, "install it")
    output = io.StringIO()
    console = Console(file=output, width=40)
    space = Finding("Free disk space", True, "9 GB", "free some")
    assert doctor.run_doctor(config(), [lambda _: iter((tc, x264, space))], True, console) == 1
    there = replace(space, fix="")  # what is there needs none
    assert json.loads(output.getvalue()) == [asdict(tc), asdict(x264), asdict(there)]


def test_a_lack_of_something_essential_alone_fails_and_each_says_what_mends_it() -> None:
    element = "apt-get install gstreamer1.0-plugins-ugly"
    tc = Finding("tc", False, "", "apt-get install iproute2", essential=False)
    x264 = Finding("GStreamer element x264enc", False, "", element)
    home = Finding("Home folder", True, "[home]", "never shown")
    code, lines = examine(lambda _: iter((x264, tc, home)))
    assert code == 1
    assert lines == [
        f"MISSING GStreamer element x264enc: {element}",
        "absent  tc: apt-get install iproute2",
        "ok      Home folder ([home])",
        "1 of these must be fixed before TAMS can run.",
    ]
    code, lines = examine(lambda _: iter((tc,)))
    assert (code, lines[-1]) == (0, "All that TAMS needs is here.")


def test_every_check_of_this_machine_gives_findings_with_a_fix() -> None:
    for check in doctor.CHECKS:
        for finding in check(config()):
            assert finding.what
            assert finding.ok or finding.fix


def test_a_missing_element_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = {"x264enc": "gstreamer1.0-plugins-ugly"}
    monkeypatch.setattr(gst, "missing_elements", lambda: missing)
    (finding,) = doctor.gstreamer(config())
    assert not finding.ok
    assert finding.what == "GStreamer element x264enc"
    assert finding.fix == "apt-get install gstreamer1.0-plugins-ugly"


@pytest.mark.parametrize("lacking", ["no-such-package>=2", "numpy>=99"])
def test_a_missing_or_old_library_is_named_as_pip_takes_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lacking: str
) -> None:
    project = tmp_path / "pyproject.toml"
    project.write_text(
        f'[project]\ndependencies = ["pydantic", "{lacking}", "none; python_version < \'3.9\'"]\n'
        "[project.optional-dependencies]\nsim = []\n"
    )
    monkeypatch.setattr(findings, "_PROJECT", project)
    (finding,) = findings.libraries(config())
    assert not finding.ok
    assert finding.detail == f"missing: {lacking}"
    assert finding.fix.endswith(f"pip install '{lacking}'")


def test_the_libraries_are_those_that_the_project_declares() -> None:
    names = {one.split(">")[0] for one in findings._requirements("")}
    assert {"numpy", "mcap", "msgspec", "zstandard", "mujoco"} <= names
    assert "cyclonedds" not in names


def test_who_publishes_in_ros_2_needs_its_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(findings, "_is_missing", lambda one: "dds" in one)
    (without,) = findings.libraries(config())
    (published,) = findings.libraries(config(recording__ros2=0))
    assert without.ok
    assert (published.ok, published.detail) == (False, "missing: cyclonedds>=11,<12")


def test_hardware_needs_neither_mujoco_nor_rendering() -> None:
    hardware = load_config(CONFIG_DIRECTORY / "lite6.yaml")
    assert not list(doctor.rendering(hardware))


def test_a_driver_that_aborts_is_a_finding_not_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_RENDER", "import os; os.abort()")
    (finding,) = doctor.rendering(config())
    assert not finding.ok
    assert "-6" in finding.detail


def lacks(**overrides: Any) -> list[Finding]:
    return [finding for finding in doctor.configuration(config(**overrides)) if not finding.ok]


@pytest.mark.parametrize(
    ("key", "value", "what"),
    [
        ("network", "s9", "Configured strategy, network and devices"),
        ("policy.budget.mode", "guess", "Configured strategy, network and devices"),
        ("faces", ["windw"], "Configured displays"),
        ("strategy", "clever", "Configured strategy, network and devices"),
    ],
)
def test_a_name_that_run_would_refuse_is_found(key: str, value: Any, what: str) -> None:
    assert not lacks()
    (finding,) = lacks(**{key: value})
    assert finding.what == what
    assert finding.essential
    assert "".join(value) in finding.fix


def doctor_where_it_fails_to_load(module: str, tmp_path: Path, how: str) -> tuple[int, str, str]:
    """Exit code and output of the doctor where importing `module` raises `how`."""
    folder = tmp_path / module
    folder.mkdir()
    (folder / "__init__.py").write_text(f"raise {how}")
    words = [sys.executable, "run_tams.py", "doctor"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        words, cwd=PROJECT_DIRECTORY, env=environment, capture_output=True, text=True
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("module", "error"),
    [
        ("typer", "ImportError"),
        ("numpy", "ImportError"),
        ("gi", "ImportError"),
        ("msgspec", "RuntimeError"),  # whatever an import raises
        *further(
            *((name, "ImportError") for name in ("rich", "pydantic", "yaml")),
            ("scipy", "RuntimeError"),
        ),
    ],
)
def test_whatever_library_is_broken_the_doctor_says_which(
    tmp_path: Path, module: str, error: str
) -> None:
    how = f"{error}('broken here')"
    code, output, errors = doctor_where_it_fails_to_load(module, tmp_path, how)
    assert code == 1
    assert "Traceback" not in errors
    assert "Python libraries" in output
    named = [line for line in output.splitlines() if line.startswith("MISSING")]
    assert any("broken here" in line for line in named)
    assert any(str(tmp_path / module) in line for line in named) or module == "gi"
    assert output.splitlines()[-1].endswith("must be fixed before TAMS can run.")


def test_a_check_that_fails_is_a_finding_and_the_others_are_made() -> None:
    def broken_drive(_: Config) -> Iterator[Finding]:
        yield Finding("Drive", True)
        raise TypeError("no such thing")

    code, (first, second, third, _) = examine(broken_drive, doctor.home_folder)
    assert code == 1
    assert first.startswith("ok      Drive")
    assert second.startswith("MISSING Check of broken drive (TypeError: no such thing): ")
    assert third.startswith("ok      Home folder")


def test_the_home_of_an_unknown_user_is_a_finding_not_a_crash() -> None:
    (finding,) = doctor.disk(config(recording__directory="~nouser/x"))
    assert not finding.ok
    assert "~nouser/x" in finding.detail
    assert "recording.directory" in finding.fix


def test_too_little_space_is_found(tmp_path: Path) -> None:
    folder, space = doctor.disk(
        config(recording__directory=str(tmp_path / "new"), recording__min_free_mb=1e9)
    )
    assert folder.ok
    assert not space.ok
    assert "1000000000 MB wanted" in space.detail


@pytest.mark.parametrize(
    ("device", "essential", "fix"),
    [
        ("auto", False, "run with --headless"),
        ("keyboard", True, "choose another --hand and --headless"),
    ],
)
def test_without_a_display_headless_is_the_way_but_for_a_keyboard(
    monkeypatch: pytest.MonkeyPatch, device: str, essential: bool, fix: str
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    (finding,) = doctor.display(config(controller__device=device))
    assert (finding.ok, finding.essential, finding.fix) == (False, essential, fix)
    assert not list(doctor.display(config(headless=True)))


def test_a_display_that_does_not_answer_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":4711")
    (finding,) = doctor.display(config())
    assert (finding.ok, finding.detail) == (False, "the display does not answer")
    (finding,) = devices.headset(config(headset__show="always"))
    assert not finding.ok
    assert finding.detail.startswith("the headset needs OpenGL on an X display")
    assert "headset.show" in finding.fix
    assert not list(devices.headset(config(headset__show="never")))
    assert not list(devices.headset(config(headset__show="always", headless=True)))


def test_a_display_without_gtk_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(toolkit, "is_installed", lambda: False)
    (finding,) = doctor.display(config())
    assert not finding.ok
    assert "gir1.2-gtk-4.0" in finding.fix


def test_of_each_view_it_is_told_whether_it_can_be_predicted_and_how_well_or_what_is_missing() -> (
    None
):
    assert not list(doctor.predictive_display(load_config(None, {})))
    rig = load_config(None, {"view.predict": "eih"})
    found = list(doctor.predictive_display(rig))
    assert [(one.ok, one.detail) for one in found] == [(True, "exact, of the simulated rig")] * 3
    lens = {"width": 640, "height": 480, "fx": 700.0, "fy": 700.0, "cx": 320.0, "cy": 240.0}
    mount = {"frame": "arm", "position_mm": [0, 0, 20], "rotation_vector_rad": [0, 0, 0]}
    real = load_config(
        None,
        {
            "rig.enabled": False,
            "cameras.eih": {
                "name": "a",
                "lens": lens | {"error_px": 0.21, "measured": "2026-11-26"},
                "mount": mount | {"error_px": 1.4},
            },
            "cameras.gt": {"name": "b", "lens": lens | {"error_px": 0.3}},
            "cameras.gs": {"name": "c"},
        },
    )
    eih, gt, gs = doctor.predictive_display(real)  # also where no view is to be predicted yet
    assert eih.ok
    assert eih.detail == "lens within 0.21 px (2026-11-26), mount within 1.4 px"
    for finding, reason in (
        (gt, "where it is was not measured"),
        (gs, "its lens was not measured"),
    ):
        assert not finding.ok
        assert not finding.essential
        assert finding.detail == reason
        assert finding.fix.startswith("it is shown as received; to measure it: run_tams.py calib")


@pytest.mark.parametrize(("free_mb", "ok"), [(16, False), (64, False), (256, True)])
def test_shared_memory_has_room_for_what_the_configuration_takes(monkeypatch, free_mb, ok):
    monkeypatch.setattr(
        os, "statvfs", lambda _: SimpleNamespace(f_bavail=free_mb, f_frsize=1 << 20)
    )
    (finding,) = doctor.shared_memory(config(rig__enabled=True))
    assert finding.ok is ok
    assert ok or "no room for 75 MB of shared memory" in finding.fix
