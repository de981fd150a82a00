"""The command line: what it prints, what it refuses, with which exit code."""

import csv
import io
import json
import re
import runpy
import socket
import subprocess
import sys
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer

from tams_app import __version__
from tams_app.cli import _main, app, main
from tams_app.config import CONFIG_DIRECTORY, DEFAULT_CONFIG, Config, load_config
from tams_app.config.whole import REMOVED
from tams_app.errors import ConfigError
from tams_app.link.identity import read_identity
from tams_app.runtime.process import PROJECT_DIRECTORY

pytestmark = pytest.mark.waiting


HARDWARE = CONFIG_DIRECTORY / "lite6.yaml"
README = PROJECT_DIRECTORY / "README.md"
# Said before what takes long to import, and some uses are found wrong by that alone.
AT_MOST_LOADING = re.compile(r"(no command given, .*\n)?(loading …\n)?")


WHERE = {"robot": ("--listen", "127.0.0.1:7499"), "operate": ("--robot", "127.0.0.1:7499")}


@pytest.fixture
def started(monkeypatch):
    """The configurations of the sessions that would have begun."""
    settings = []
    for name in ("app.run_session", "app.run_robot", "app.run_operate"):
        monkeypatch.setattr(
            f"tams_app.console.{name}", lambda config, *_, **__: settings.append(config)
        )
    return settings


def refused(tams, tmp_path, command, *options):
    """Exit code and the one sentence of a session that is refused before it leaves anything."""
    where = ("--out", tmp_path / "logs", *WHERE.get(command, ()))
    code, out, err = tams(command, *options, *where)
    assert AT_MOST_LOADING.fullmatch(out)
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "logs").exists()
    return code, err


def test_allocate_prints_whole_kbits_as_json(tams):
    code, out, _ = tams("allocate", "--phase", "ALIGN", "--budget-kbps", 5520, "--json")
    assert code == 0
    assert json.loads(out) == {"eih": 3192, "gt": 1164, "gs": 1164}  # 150 + w (5520 - 450)


def test_allocate_takes_strategy_and_floor(tams):
    options = ("--strategy", "static", "--floor-kbps", 0, "--json")
    _, out, _ = tams("allocate", "--phase", "REACH", "--budget-kbps", 1000, *options)
    assert json.loads(out) == {"eih": 500, "gt": 250, "gs": 250}


@pytest.mark.parametrize("name", ["PRE_RELEASE", "pre_release", "Pre-release", "pre release"])
def test_a_phase_may_be_named_as_in_the_paper(tams, name):
    code, out, _ = tams("allocate", "--phase", name, "--budget-kbps", 5520, "--json")
    assert code == 0
    assert json.loads(out) == {"eih": 2938, "gt": 1417, "gs": 1164}


def test_a_floor_that_cannot_be_kept_is_said_beside_the_targets(tams):
    code, out, err = tams("allocate", "--phase", "ALIGN", "--budget-kbps", 449, "--json")
    assert code == 0
    assert json.loads(out) == {"eih": 149, "gt": 149, "gs": 149}
    assert "449 kbit/s are less than the floor of 150 kbit/s for each of 3 views" in err
    assert tams("allocate", "--phase", "ALIGN", "--budget-kbps", 450)[2] == ""


@pytest.mark.parametrize("make_link", [None, Path.symlink_to, Path.hardlink_to])
def test_phases_does_not_write_over_its_input(tams, tmp_path, make_link):
    table, out = tmp_path / "speeds.csv", tmp_path / "speeds.csv"
    text = "t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\n0,0,0,0,0\n"
    table.write_text(text)
    if make_link is not None:
        out = tmp_path / "other.csv"
        make_link(out, table)
    code, _, err = tams("phases", table, "--out", out)
    assert code == 2
    assert "is the table that is read" in err
    assert table.read_text() == text


def test_phases_labels_a_file_and_writes_where_told(tams, tmp_path):
    table = tmp_path / "speeds.csv"
    table.write_text(
        "t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\n" + "".join(f"{i / 10},0,0,-50,0\n" for i in range(6))
    )
    target = tmp_path / "labelled.csv"
    assert tams("phases", table, "--no-smoothing", "--out", target)[0] == 0
    rows = list(csv.DictReader(io.StringIO(target.read_text())))
    assert [row["phase"] for row in rows] == ["REACH"] * 3 + ["ALIGN"] * 3
    _, out, _ = tams("phases", table, "--no-smoothing", "--align-dwell-s", 0.1)
    assert [row["phase"] for row in csv.DictReader(io.StringIO(out))][1] == "ALIGN"


def test_the_version_is_told(tams):
    assert tams("--version") == (0, f"TAMS {__version__}\n", "")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["bogus"], "No such command 'bogus'"),
        (["rnu"], "Did you mean 'run'? (see run_tams.py --help)"),
        (["run", "--netwrk", "s2"], "--network) (see run_tams.py run --help)"),
        (["study", "rnu"], "Did you mean 'run'? (see run_tams.py study --help)"),
        (["run", "--strategy", "tms"], "'tms' is not one of equal, static, tams, tams+; did you"),
        (["run", "--network", "S3"], "did you mean s3?"),
        (["run", "--operator", "seing"], "seeing, scripted; did you mean seeing?"),
        (["run", "--hand", "keybord"], "did you mean keyboard?"),
        (["network", "s2", "--interface", "eth0", "--action", "aply"], "did you mean apply?"),
        (["allocate", "--phase", "Aling", "--budget-kbps", 1], "did you mean Align?"),
        (["allocate", "--phase", "ALIGN"], "Missing option '--budget-kbps'"),
        (["allocate", "--phase", "ALIGN", "--budget-kbps", "inf"], "infinity is not a rate"),
        (["allocate", "--phase", "ALIGN", "--budget-kbps", "nan"], "NaN is not a rate"),
        (["allocate", "--phase", "ALIGN", "--budget-kbps", -1], "-1 is not a rate"),
        (["allocate", "--phase", "ALIGN", "--budget-kbps", "much"], "'much' is not a number"),
        (
            ["allocate", "--phase", "ALIGN", "--budget-kbps", 9, "--floor-kbps", "nan"],
            "NaN is not a rate",
        ),
        (["phases", "any.csv", "--v-eps-mm-s", "nan"], "v_eps_mm_s: must be a finite number"),
        (["phases", "missing.csv"], "missing.csv: cannot be read"),
        (["run", "--budget", "guess"], "policy.budget.mode"),
        (["run", "--seconds", 0], "seconds: must be greater than 0 (given: 0)"),
        (["run", "--seconds", "nan"], "seconds: must be a finite number (given: NaN)"),
        (["run", "--fps", 0], "video.fps: must be greater than or equal to 5 (given: 0)"),
        (["run", "--fps", 61], "video.fps: must be less than or equal to 60 (given: 61)"),
        (["run", "--fps", "many"], "Invalid value for '--fps'"),
        (["run", "--foxglove", "everywhere"], "'everywhere' is not HOST:PORT"),
        (["run", "--ros2", "everywhere"], "Invalid value for '--ros2'"),
        (["run", "--ros2", 233], "recording.ros2: must be less than or equal to 232 (given: 233)"),
        (["run", "--config", "missing.yaml"], "missing.yaml: cannot be read"),
        (["run", "--config", HARDWARE, "--arm"], "--arm works on the simulated rig only"),
        (["--seed", -1], "seed"),
        (["home"], "home"),
        (["home", "--config", "missing.yaml"], "missing.yaml: cannot be read"),
        (["doctor", "--config", "missing.yaml"], "missing.yaml: cannot be read"),
        (["doctor", "--link", "h:1", "--devices"], "--devices and --link: one at a time"),
        (["doctor", "--link", "h:1", "--config", "any.yaml"], "--config: --link needs none"),
        (["doctor", "--key", "lab.key"], "--key: is for --link"),
        (["report", "missing"], "missing"),
        (["report", README], "README.md"),
        (["network", "s2", "--interface", "lo"], "lo"),
        (["network", "s9", "--interface", "eth0"], "'s9' is not one of s1, s2, s3, none"),
        (["phases", README], "README.md"),
        (["calibrate", "frame", "--config", "missing.yaml"], "missing.yaml: cannot be read"),
        (
            ["calibrate", "frame", "--from", "missing"],
            "--from: recorded strokes cannot be tried out",
        ),
        (["calibrate", "phases", "--from", "missing"], "1 trial is too few"),
        (["calibrate", "weights", "--from", "missing"], "missing"),
        (["calibrate", "cameras", "--from", "missing"], "--from: `calibrate cameras` measures"),
        (["run", "--metrics"], "--metrics: there are no figures for Prometheus any more: Foxglove"),
        (["operate", "--metrics=h:1"], "--metrics: there are no figures for Prometheus any more"),
        (["--metrics", "h:1"], "--metrics: there are no figures for Prometheus any more: Foxglove"),
        (["replay", "logs", "--recompute"], "--recompute: what the code makes of a recorded"),
        (["doctor", "--speed"], "--speed: a session says at its end where frames were missing"),
        (["key", "new", "."], "--for NAME"),
        (["key", "new", "x.key", "--for", "a/b"], "is no name"),
        (["key", "list", "nothing.key"], "cannot be read"),
        (["key", "list", "."], "has no key"),
        (["key", "revoke", ".", "kim"], "has no key"),
    ],
)
def test_wrong_use_is_one_sentence_exit_code_two_and_leaves_nothing_behind(
    tams, monkeypatch, tmp_path, arguments, sentence
):
    monkeypatch.chdir(tmp_path)
    is_run = arguments[0] in ("run", "--seed")
    code, out, err = tams(*arguments, *(("--out", tmp_path) if is_run else ()))
    assert code == 2
    assert AT_MOST_LOADING.fullmatch(out)
    assert sentence in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "key", "value"),
    [
        (["run"], "video.fps", 30),
        (["run", "--fps", 12], "video.fps", 12),
        (["run"], "recording.foxglove", ""),
        (["run", "--foxglove"], "recording.foxglove", "127.0.0.1:8765"),
        (["run", "--foxglove", "--headless"], "recording.foxglove", "127.0.0.1:8765"),
        (["run", "--foxglove", "0.0.0.0:9000", "--headless"], "recording.foxglove", "0.0.0.0:9000"),
        (["--foxglove"], "recording.foxglove", "127.0.0.1:8765"),
        (["run"], "recording.ros2", None),
        (["run", "--ros2"], "recording.ros2", 0),
        (["run", "--ros2", "--foxglove", "--headless"], "recording.ros2", 0),
        (["run", "--ros2", "42", "--headless"], "recording.ros2", 42),
        *(
            ([command, *WHERE.get(command, ()), *words], f"recording.{key}", value)
            for command in ("run", "robot")
            for words, key, value in (
                ([], "episodes", False),
                (["--episodes"], "episodes", True),
                (["--episodes"], "episode_count", 0),
                (["--episodes", "10"], "episodes", True),
                (["--episodes", "10"], "episode_count", 10),
            )
        ),
    ],
)
def test_an_option_sets_its_key_and_without_it_the_configuration_counts(
    tams, started, arguments, key, value
):
    assert tams(*arguments)[0] == 0
    assert [attrgetter(key)(one) for one in started] == [value]


@pytest.mark.parametrize("command", ["run", "robot", "operate"])
def test_without_the_extra_of_ros_2_it_is_one_sentence_before_a_session_leaves_anything(
    tams, monkeypatch, tmp_path, command
):
    monkeypatch.setattr("tams_app.errors.find_spec", lambda name: None)
    code, err = refused(tams, tmp_path, command, "--ros2")
    assert code == 1
    assert "--ros2 needs cyclonedds and rosbags: make extras" in err


@pytest.mark.parametrize(
    ("key", "stored", "asking", "sentence"),
    [
        ("recording.metrics", "", "127.0.0.1:9464", "no figures .*summary.json"),
        ("arm.servo", "velocity", "position", "the arm follows velocities"),
        ("controller.desk.wireless", None, False, "use the keyboard, or install a driver"),
        ("controller.desk.dead_zone", 0.12, 0.2, "use the keyboard, or install a driver"),
    ],
)
def test_a_removed_key_is_left_out_of_stored_configurations_and_told_where_it_asks_for_something(
    key, stored, asking, sentence
):
    assert load_config(None, {key: stored}) == load_config()
    with pytest.raises(ConfigError, match=f"command line: {key}: .*{sentence}"):
        load_config(None, {key: asking})
    section = logged = load_config().model_dump(mode="json")
    *parents, name = key.split(".")
    for parent in parents:
        section = section[parent]
    section[name] = asking
    assert Config.model_validate(logged) == load_config(), "a log can be read"


@pytest.mark.parametrize("command", ["run", "robot", "operate"])
def test_a_port_in_use_is_one_sentence_before_a_session_leaves_anything(tams, tmp_path, command):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        code, err = refused(tams, tmp_path, command, "--foxglove", address)
    assert code == 1
    assert f"--foxglove: nothing can connect at {address}" in err


WINDOW = "faces: 'windw' is not one of window, headset; did you mean window?"
UNKNOWN = "controller.device: 'pedal' is not one of auto, openvr, keyboard, sim"


@pytest.mark.parametrize(
    ("command", "content", "sentence"),
    [
        ("run", "faces: [windw]", WINDOW),
        ("robot", "faces: [windw]", WINDOW),
        ("operate", "faces: [windw]", WINDOW),
        ("run", "faces: [window, window]", "faces: window, window: each may be named once only"),
        (
            "operate",
            "faces: [headset]\ncontroller: {device: keyboard}",
            "faces: controller.device keyboard needs the window",
        ),
        ("run", "faces: [window, sounds]", f"faces: sounds: {REMOVED['sounds']}"),
        ("run", "controller: {device: pedal}", UNKNOWN),
        ("operate", "controller: {device: pedal}", UNKNOWN),
        ("run", "controller: {device: gamepad}", f"controller.device: {REMOVED['gamepad']}"),
        (
            "robot",
            "policy: {budget: {mode: guess}}",
            "policy.budget.mode: 'guess' is not one of oracle, sender, feedback",
        ),
        (
            "run",
            "policy: {phases: {inference: guess}}",
            "policy.phases.inference: 'guess' is not one of motion, reference",
        ),
    ],
)
def test_a_word_that_stands_for_nothing_is_one_sentence_before_a_session_leaves_anything(
    tams, tmp_path, command, content, sentence
):
    config = tmp_path / "lab.yaml"
    config.write_text(f"include: [{DEFAULT_CONFIG}]\n{content}\n")
    assert refused(tams, tmp_path, command, "--config", config) == (2, f"tams: {sentence}\n")


def with_keyboard(folder):
    path = folder / "yours.yaml"
    path.write_text(f"include: [{HARDWARE}]\ncontroller: {{device: keyboard}}\n")
    return path


def test_the_simulated_rig_is_driven_by_the_hand_that_is_configured(tams, started, tmp_path):
    command = ("run", "--sim", "--config", with_keyboard(tmp_path))
    assert tams(*command)[0] == 0
    assert tams(*command, "--hand", "sim")[0] == 0
    assert tams("run", "--sim", "--config", HARDWARE)[0] == 0
    assert [
        (one.rig.enabled, one.controller.device, one.operator_is_simulated) for one in started
    ] == [(True, "keyboard", False), (True, "sim", True), (True, "auto", True)]


@pytest.mark.parametrize(
    ("command", "promise"),
    [
        (["run"], "--sim Use the simulated arm and cameras, not the configured ones."),
        (["robot"], "--sim Use the simulated arm and cameras, not the configured ones."),
        (["network"], "With `run` it stays on loopback"),
        ([], "Exit codes: 0 done; 1 the job failed; 2 wrong use"),
    ],
)
def test_help_says_what_it_promises(tams, command, promise):
    code, out, _ = tams(*command, "--help")
    assert code == 0
    assert promise in " ".join(out.split())
    assert "leaves by" not in out


def test_operate_with_sim_has_the_simulated_operator_unless_a_hand_is_named(
    tams, started, tmp_path
):
    command = ("operate", *WHERE["operate"], "--config", with_keyboard(tmp_path))
    assert tams(*command)[0] == 0
    assert tams(*command, "--sim")[0] == 0
    assert tams(*command, "--sim", "--hand", "keyboard")[0] == 0
    assert [one.operator_is_simulated for one in started] == [False, True, False]


def test_an_unreadable_trace_names_file_and_line(tams, tmp_path):
    trace = tmp_path / "bad.csv"
    trace.write_text("t_ms,kbps\n0,1000\nsoon,1000\n")
    code, _, err = tams("run", "--network", trace, "--out", tmp_path)
    assert code == 2
    assert str(trace) in err
    assert "line 3" in err


ABSENT = {"host": "127.0.0.1", "control_port": 1, "report_port": 2}  # an arm that is not there


def test_an_arm_that_is_not_there_is_one_sentence_and_leaves_no_session_folder(tams, tmp_path):
    config = tmp_path / "hardware.yaml"
    config.write_text(f"version: 1\ninclude: [{HARDWARE}]\narm: {json.dumps(ABSENT)}\n")
    code, _, err = tams("run", "--config", config, "--headless", "--out", tmp_path / "logs")
    assert code == 1
    assert len(err.splitlines()) == 1
    assert "127.0.0.1:1" in err
    assert not list((tmp_path / "logs").iterdir())


def test_hardware_needs_a_camera_for_every_view(tams, tmp_path):
    config = tmp_path / "hardware.yaml"
    config.write_text(f"version: 1\ninclude: [{DEFAULT_CONFIG}]\nrig: {{enabled: false}}\n")
    code, _, err = tams("run", "--config", config, "--out", tmp_path)
    assert code == 2
    assert "cameras lacks eih, gt, gs of video.views" in err


@pytest.mark.parametrize("camera", [{"source": "pattern"}, {"source": "file", "file": "a.mkv"}])
def test_a_real_arm_is_not_driven_by_frames_that_do_not_show_it(
    tams, tmp_path, monkeypatch, camera
):
    cameras = {"eih": {"path": "/dev/video0"}, "gt": {"path": "/dev/video2"}, "gs": camera}
    station = {"include": [str(DEFAULT_CONFIG)], "rig": {"enabled": False}}
    config = tmp_path / "station.yaml"
    config.write_text(json.dumps({"version": 1, **station, "arm": ABSENT, "cameras": cameras}))
    logs = tmp_path / "logs"
    code, _, err = tams("run", "--config", config, "--headless", "--out", logs)
    assert code == 2
    assert f"cameras.gs.source is {camera['source']}" in err
    assert len(err.splitlines()) == 1
    assert not logs.exists()
    begun = []
    monkeypatch.setattr("tams_app.console.app.run_and_report", lambda *_, **__: begun.append(1))
    assert tams("run", "--config", config, "--dry-run", "--headless", "--out", logs)[0] == 0
    assert begun, "a dry run goes on"


def interrupt(*_):
    raise KeyboardInterrupt


def run_as_main(capsys):
    """The exit code and stderr of run_tams.py in this process."""
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(PROJECT_DIRECTORY / "run_tams.py"), run_name="__main__")
    return ended.value.code, capsys.readouterr().err


def test_ctrl_c_among_the_imports_is_one_sentence_and_exit_code_130(capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "tams_app.cli")
    find_spec = lambda name, *_: interrupt() if name == "tams_app.cli" else None  # noqa: E731
    monkeypatch.setattr(sys, "meta_path", [SimpleNamespace(find_spec=find_spec), *sys.meta_path])
    assert run_as_main(capsys) == (130, "tams: interrupted\n")


# Each command, with what it needs on its command line and what it calls first.
COMMANDS = {
    "run": ([], "tams_app.console.options.load_config"),
    "home": ([], "tams_app.cli.load_config"),
    "doctor": ([], "tams_app.cli.load_config"),
    "report": (["somewhere"], "tams_app.console.report.report_session"),
    "network": (["s2", "--interface", "eth0"], "tams_app.console.options.load_config"),
    "phases": (["some.csv"], "tams_app.console.options.load_config"),
    "allocate": (
        ["--phase", "ALIGN", "--budget-kbps", "1"],
        "tams_app.console.options.load_config",
    ),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_ctrl_c_in_any_command_is_one_sentence_and_exit_code_130(capsys, monkeypatch, command):
    options, first = COMMANDS[command]
    monkeypatch.setattr(first, interrupt)
    monkeypatch.setattr(sys, "argv", ["run_tams.py", command, *options])
    assert run_as_main(capsys) == (130, "tams: interrupted\n")


@pytest.mark.parametrize("program", ["tams", "run_tams.py"])
def test_help_and_advice_name_the_program_as_it_was_called(capsys, monkeypatch, program):
    for arguments, told in (
        (["allocate", "--help"], "Usage: {} allocate"),
        (["bogus"], "(see {} --help)"),
        (["allocate", "--bogus"], "(see {} allocate --help)"),
    ):
        monkeypatch.setattr(sys, "argv", [f"/somewhere/bin/{program}", *arguments])
        with pytest.raises(SystemExit):
            main()
        captured = capsys.readouterr()
        assert told.format(program) in captured.out + captured.err


@pytest.mark.parametrize("arguments", [[], ["--headless"], ["--foxglove"]])
def test_without_a_command_it_is_run_and_says_so_first(capsys, started, arguments):
    assert _main(arguments) == 0
    assert capsys.readouterr().out.startswith("no command given, so this is `run_tams.py run`")
    (config,) = started
    assert config.headless == ("--headless" in arguments)
    assert bool(config.recording.foxglove) == ("--foxglove" in arguments)


def every_command(group, path=()):
    for name, command in sorted(group.commands.items()):
        yield (*path, name)
        if hasattr(command, "commands"):
            yield from every_command(command, (*path, name))


ALL_COMMANDS = list(every_command(typer.main.get_command(app)))


@pytest.mark.parametrize("command", ALL_COMMANDS, ids=" ".join)
def test_every_command_has_help_by_both_names(tams, command):
    short, long = tams(*command, "-h"), tams(*command, "--help")
    assert short == long
    assert short[0] == 0
    assert "Usage:" in short[1]


@pytest.fixture
def completed(capsys, monkeypatch):
    """What a shell is told of the last of some words."""

    def complete(words):
        number = str(len(words.split()) - 1)
        asked = {"_TAMS_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": number}
        for name, value in asked.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(sys, "argv", ["tams"])
        with pytest.raises(SystemExit):
            main()
        out, err = capsys.readouterr()
        assert err == ""
        return out.split()

    return complete


@pytest.mark.parametrize(
    ("words", "completions"),
    [
        ("tams ro", ["robot"]),
        ("tams run --strategy ta", ["tams", "tams+"]),
        ("tams run --network config/", []),  # the shell offers files
        ("tams doctor --dev", ["--devices"]),
        ("tams operate --hand key", ["keyboard"]),
        ("tams robot --network no", ["none"]),
        ("tams network s", ["s1", "s2", "s3"]),
        ("tams network s3 --action r", ["rate", "remove"]),
        ("tams run --operator s", ["seeing", "scripted"]),
        ("tams allocate --phase Re", ["Reach", "Release"]),
        ("tams log show SESSION --topic /link/", ["/link/hand", "/link/state", "/link/health"]),
        ("tams log csv SESSION /ph", ["/phase"]),
    ],
)
def test_a_shell_completes_commands_options_and_values(completed, words, completions):
    assert completed(words) == completions


def test_a_shell_completes_the_networks_of_the_configuration_that_is_named(completed, tmp_path):
    own, broken = tmp_path / "own.yaml", tmp_path / "broken.yaml"
    own.write_text("include: [tams.yaml]\nnetworks: {garage: {rate_kbps: 900}}\n")
    broken.write_text("networks: [\n")
    assert completed(f"tams run --config {own} --network g") == ["garage"]
    assert completed(f"tams run --config {broken} --network s") == []


@pytest.mark.parametrize("group", [(), ("calibrate",), ("key",), ("log",), ("study",)])
def test_the_list_of_commands_cuts_no_description(tams, group):
    _, out, _ = tams(*group, "--help")
    assert "..." not in out.partition("Commands:")[2]


def test_debug_shows_where_it_came_from():
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


def test_keys_are_made_listed_and_revoked_by_name(tams, tmp_path):
    for name in ("kim", "kay"):
        code, out, _ = tams("key", "new", tmp_path, "--for", name)
        assert code == 0
        assert f"{name}.key: a new key" in out
    robot = read_identity(tmp_path).public.hex()[:8]
    both = f"kay (robot {robot})\nkim (robot {robot})\n"
    assert tams("key", "list", tmp_path)[:2] == (0, both)
    code, out, _ = tams("key", "revoke", tmp_path, "kim")
    assert code == 0
    assert "kim.key: deleted" in out
    assert tams("key", "list", tmp_path)[:2] == (0, f"kay (robot {robot})\n")


def test_the_robots_side_needs_its_identity_and_the_operators_a_key(tams, tmp_path):
    tams("key", "new", tmp_path / "lab.key")
    identity = tmp_path / "robot.identity"
    at = ("--robot", "127.0.0.1:1", "--key")
    assert tams("operate", *at, identity)[::2] == (
        2,
        f"tams: --key: {identity}: is a robot's identity, which belongs on the robot's computer "
        "alone; name a key that was made beside it, with: key new FILE\n",
    )
    identity.unlink()
    code, _, error = tams("robot", "--listen", "127.0.0.1:7300", "--key", tmp_path / "lab.key")
    assert (code, error) == (
        2,
        f"tams: --key: {identity}: cannot be read (No such file or directory); name keys that were "
        "made on this computer, with: key new FILE\n",
    )
