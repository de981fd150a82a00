"""The command line: what it prints, what it refuses, with which exit code."""

import csv
import io
import json
import runpy
import subprocess
import sys

import pytest

from tams_app import __version__
from tams_app.cli import _main
from tams_app.config import CONFIG_DIRECTORY, DEFAULT_CONFIG
from tams_app.runtime.process import PROJECT_DIRECTORY

pytestmark = pytest.mark.waiting


def run(capsys, *arguments):
    code = _main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_allocate_prints_whole_kbits_as_json(capsys):
    code, out, _ = run(
        capsys, "allocate", "--phase", "ALIGN", "--budget-kbps", 5520, "--json"
    )  # 150 + w (5520 - 450)
    assert code == 0
    assert json.loads(out) == {"eih": 3192, "gt": 1164, "gs": 1164}


def test_allocate_takes_strategy_and_floor(capsys):
    options = ("--strategy", "static", "--floor-kbps", 0, "--json")
    _, out, _ = run(capsys, "allocate", "--phase", "REACH", "--budget-kbps", 1000, *options)
    assert json.loads(out) == {"eih": 500, "gt": 250, "gs": 250}


def test_phases_labels_a_file_and_writes_where_told(capsys, tmp_path):
    table = tmp_path / "speeds.csv"
    table.write_text(
        "t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\n" + "".join(f"{i / 10},0,0,-50,0\n" for i in range(6))
    )
    target = tmp_path / "labelled.csv"
    assert run(capsys, "phases", table, "--no-smoothing", "--out", target)[0] == 0
    rows = list(csv.DictReader(io.StringIO(target.read_text())))
    assert [row["phase"] for row in rows] == ["REACH"] * 3 + ["ALIGN"] * 3
    _, out, _ = run(capsys, "phases", table, "--no-smoothing", "--align-dwell-s", 0.1)
    assert [row["phase"] for row in csv.DictReader(io.StringIO(out))][1] == "ALIGN"


def test_the_version_is_told(capsys):
    assert run(capsys, "--version") == (0, f"TAMS {__version__}\n", "")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["bogus"], "No such command 'bogus'"),
        (["allocate", "--phase", "ALIGN"], "Missing option '--budget-kbps'"),
        (["allocate", "--phase", "LUNCH", "--budget-kbps", 1], "'LUNCH' is none of REACH"),
        (["allocate", "--phase", "ALIGN", "--budget-kbps", "inf"], "--budget-kbps"),
        (["allocate", "--phase", "ALIGN", "--budget-kbps", "nan"], "--budget-kbps"),
        (["allocate", "--phase", "ALIGN", "--budget-kbps", -1], "--budget-kbps"),
        (
            ["allocate", "--phase", "ALIGN", "--budget-kbps", 9, "--strategy", "best"],
            "'best' is none of equal, static, tams",
        ),
        (["phases", "missing.csv"], "missing.csv: cannot be read"),
        (["run", "--network", "s9"], "'s9' is neither one of s1, s2, s3, none nor a trace"),
        (["run", "--strategy", "best"], "'best' is none of equal, static, tams"),
        (["run", "--budget", "guess"], "policy.budget.mode"),
        (["run", "--seconds", 0], "seconds"),
        (["run", "--config", "missing.yaml"], "missing.yaml: cannot be read"),
        (["--seed", -1], "seed"),
        (["network", "s2", "--interface", "lo"], "lo"),
    ],
)
def test_wrong_use_is_one_sentence_and_exit_code_two(capsys, tmp_path, arguments, sentence):
    is_run = arguments[0] in ("run", "--seed")
    code, out, err = run(capsys, *arguments, *(("--out", tmp_path) if is_run else ()))
    assert code == 2
    assert out == ""
    assert sentence in err
    assert len(err.splitlines()) == 1


def test_an_unreadable_trace_names_file_and_line(capsys, tmp_path):
    trace = tmp_path / "bad.csv"
    trace.write_text("t_ms,kbps\n0,1000\nsoon,1000\n")
    code, _, err = run(capsys, "run", "--network", trace, "--out", tmp_path)
    assert code == 2
    assert str(trace) in err
    assert "line 3" in err


HARDWARE = CONFIG_DIRECTORY / "lite6.yaml"


def hardware(tmp_path, **arm):
    """The hardware profile with an arm that is not there."""
    config = tmp_path / "hardware.yaml"
    arm = {"host": "127.0.0.1", "control_port": 1, "report_port": 2, **arm}
    config.write_text(f"version: 1\ninclude: [{HARDWARE}]\narm: {json.dumps(arm)}\n")
    return config


def test_an_arm_that_is_not_there_is_one_sentence_and_leaves_a_session_folder(capsys, tmp_path):
    config = hardware(tmp_path)
    code, _, err = run(capsys, "run", "--config", config, "--headless", "--out", tmp_path / "logs")
    assert code == 1
    assert len(err.splitlines()) == 1
    assert "127.0.0.1:1" in err
    (folder,) = (tmp_path / "logs").iterdir()
    assert (folder / "session.mcap").exists()


def test_hardware_is_never_armed_without_asking(capsys, tmp_path):
    code, _, err = run(capsys, "run", "--config", HARDWARE, "--arm", "--out", tmp_path)
    assert code == 2
    assert "--arm works on the simulated rig only" in err


def test_hardware_needs_a_camera_for_every_view(capsys, tmp_path):
    config = tmp_path / "hardware.yaml"
    config.write_text(f"version: 1\ninclude: [{DEFAULT_CONFIG}]\nrig: {{enabled: false}}\n")
    code, _, err = run(capsys, "run", "--config", config, "--out", tmp_path)
    assert code == 2
    assert "cameras must name each of video.views" in err


@pytest.mark.parametrize("camera", [{"source": "pattern"}, {"source": "file", "file": "a.mkv"}])
def test_a_real_arm_is_not_driven_by_frames_that_do_not_show_it(capsys, tmp_path, camera):
    cameras = {"eih": {"path": "/dev/video0"}, "gt": {"path": "/dev/video2"}, "gs": camera}
    arm = {"host": "127.0.0.1", "control_port": 1, "report_port": 2}
    station = {"include": [str(DEFAULT_CONFIG)], "rig": {"enabled": False}}
    config = tmp_path / "station.yaml"
    config.write_text(json.dumps({"version": 1, **station, "arm": arm, "cameras": cameras}))
    logs = tmp_path / "logs"
    code, _, err = run(capsys, "run", "--config", config, "--headless", "--out", logs)
    assert code == 2
    assert f"cameras.gs.source is {camera['source']}" in err
    assert len(err.splitlines()) == 1
    assert not logs.exists()
    dry = ("run", "--config", config, "--dry-run", "--headless", "--out", logs)
    assert "127.0.0.1:1" in run(capsys, *dry)[2], "a dry run goes on, to an arm that is not there"


def test_the_help_of_network_promises_nothing_of_the_video(capsys):
    code, out, _ = run(capsys, "network", "--help")
    assert code == 0
    assert "nothing of the video" in " ".join(out.split())
    assert "leaves by" not in out


def test_home_needs_hardware_to_move(capsys):
    code, _, err = run(capsys, "home")
    assert code == 2
    assert len(err.splitlines()) == 1


class InterruptingImport:
    """Ctrl-C while the command line is being imported."""

    @staticmethod
    def find_spec(name, *_):
        if name == "tams_app.cli":
            raise KeyboardInterrupt


def interrupt(*_):
    raise KeyboardInterrupt


def test_ctrl_c_among_the_imports_is_one_sentence_and_exit_code_one(monkeypatch):
    monkeypatch.delitem(sys.modules, "tams_app.cli")
    monkeypatch.setattr(sys, "meta_path", [InterruptingImport, *sys.meta_path])
    with pytest.raises(SystemExit, match=r"^tams: interrupted$"):
        runpy.run_path(str(PROJECT_DIRECTORY / "run_tams.py"), run_name="__main__")


@pytest.mark.parametrize("command", ["home", "doctor", "run", "allocate"])
def test_ctrl_c_in_any_command_is_one_sentence_and_exit_code_one(monkeypatch, command):
    monkeypatch.setattr("tams_app.cli.load_config", interrupt)
    options = ["--phase", "ALIGN", "--budget-kbps", "1"] if command == "allocate" else []
    monkeypatch.setattr(sys, "argv", ["run_tams.py", command, *options])
    with pytest.raises(SystemExit, match=r"^tams: interrupted$"):
        runpy.run_path(str(PROJECT_DIRECTORY / "run_tams.py"), run_name="__main__")


def test_debug_shows_where_it_came_from():
    from tams_app.errors import ConfigError

    with pytest.raises(ConfigError):
        _main(["--debug", "allocate", "--phase", "LUNCH", "--budget-kbps", "1"])


def test_a_full_standard_output_is_one_sentence(tmp_path):
    table = tmp_path / "speeds.csv"
    table.write_text("t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\n0,0,0,0,0\n")
    with open("/dev/full", "w") as full:
        result = subprocess.run(
            [sys.executable, "run_tams.py", "phases", str(table)],
            cwd=PROJECT_DIRECTORY,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=60,
        )
    assert result.returncode == 1
    assert result.stderr == "tams: standard output cannot be written: No space left on device\n"
