"""The configuration: what is accepted, and the one sentence for what is not."""

import math
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tams_app.config import (
    DEFAULT_CONFIG,
    Config,
    dump_config,
    load_config,
    stop_time_s,
)
from tams_app.config.yaml_file import find_config_directory, writable_directory
from tams_app.console.explain import all_sections, explain, meaning
from tams_app.errors import ConfigError
from tams_app.records import Phase

pytestmark = pytest.mark.untimed

NAN = math.nan
REMOVED = "  tams_plus: {redistribution: true, lookahead: true, ladder: false}\n"


def test_the_default_is_the_paper_s_set_up():
    config = load_config()
    assert config.policy.weights.matrix[Phase.ALIGN] == {"eih": 0.60, "gt": 0.20, "gs": 0.20}
    s2 = config.networks["s2"]
    assert (s2.latency_ms, s2.jitter_ms, s2.loss, s2.rate_kbps) == (40, 8, 0.003, 6000)
    assert config.policy.budget.safety_factor == 0.92


def test_the_effective_configuration_reads_back_the_same(tmp_path):
    config = load_config(None, {"seed": 7, "limits.max_speed_mm_s": 120})
    path = tmp_path / "config.yaml"
    path.write_text(dump_config(config))
    assert load_config(path) == config


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        ({"speed": 1}, "speed: no such key"),
        ({"rig.enabled": False, "rig.hand_trajectory": "a.mcap"}, "rig: hand_trajectory is for"),
        (
            {"control.rate_hz": 30, "arm.guard.heartbeat_timeout_ms": 60},
            "heartbeat_timeout_ms must be at least two periods of control.rate_hz, 67 ms",
        ),
        (
            {"limits.max_sped_mm_s": 1},
            r"limits.max_sped_mm_s: no such key, did you mean limits.max_speed_mm_s\? .given: 1.$",
        ),
        ({"max_speed_mm_s": 1}, r"max_speed_mm_s: no such key, did you mean limits.max_speed_mm_s"),
        ({"networks.s2.latncy_ms": 1}, r"no such key, did you mean networks.s2.latency_ms\?"),
        ({"video.repair.plo": True}, r"did you mean video.repair.pli\? .given: true.$"),
        ({"limits.box_max_mm": [1, 2, NAN]}, r"box_max_mm.2: must be a finite .* .given: NaN.$"),
        ({"video.quality.enabled": "maybe"}, r"enabled: must be a valid boolean.* .given: 'maybe'"),
        ({"hand.max_rejects": 7}, "max_rejects: is a constant of tams_app.teleop.motion now, 6"),
        ({"clutch.release_below": 0.3}, "clutch.release_below: is a constant of tams_app.presses"),
        ({"limits": 3}, r"limits: must hold keys and values .given: 3.$"),
        ({"policy.weights.matrix.REACH.gt": 0.6}, "matrix.REACH sums to 1.1, not 1"),
        ({"limits.max_speed_mm_s": 300}, "max_speed_mm_s needs 110 ms to stop"),
        ({"limits.max_rotation_rad_s": 3}, "max_rotation_rad_s needs .* ms to stop"),
        ({"limits.motion.jerk_m_s3": 0}, "limits.motion.jerk_m_s3: .*greater than 0"),
        ({"arm.velocity_deadman_s": 0}, "arm.velocity_deadman_s: .*greater than 0"),
        ({"arm.velocity_deadman_s": math.inf}, r"velocity_deadman_s: .* .given: infinity.$"),
        (
            {"arm.velocity_deadman_s": 1.01},
            "velocity_deadman_s: .*less than or equal to 1 .given: 1.",
        ),
        ({"freshness.pose_frozen_ms": 2001}, "pose_frozen_ms: .*less than or equal to 2000"),
        ({"freshness.buttons_ms": 2001}, "buttons_ms: .*less than or equal to 2000"),
        ({"freshness.arm_state_ms": 2001}, "arm_state_ms: .*less than or equal to 2000"),
        ({"freshness.arm_reply_ms": 2001}, "arm_reply_ms: .*less than or equal to 2000"),
        ({"freshness.hold_pose_ms": 201}, "hold_pose_ms: .*less than or equal to 200"),
        ({"freshness.video_hold_ms": 5001}, "video_hold_ms: .*less than or equal to 5000"),
        ({"freshness.video_slow_ms": 5001}, "video_slow_ms: .*less than or equal to 5000"),
        ({"limits.leash_fault_mm": 101}, "leash_fault_mm: .*less than or equal to 100"),
        ({"limits.leash_mm": 51}, "leash_mm: .*less than or equal to 50"),
        ({"limits.leash_mm": 50, "limits.leash_fault_mm": 50}, "leash_mm must be smaller"),
        ({"limits.leash_rad": 0.6}, "leash_rad: .*less than or equal to 0.5"),
        ({"limits.leash_fault_rad": 1.1}, "leash_fault_rad: .*less than or equal to 1"),
        ({"limits.leash_rad": 0.2, "limits.leash_fault_rad": 0.2}, "leash_rad must be smaller"),
        ({"limits.floor_mm": 400}, "floor_mm must be below the top of the box"),
        ({"arm.tcp_load_kg": 1.1}, "tcp_load_kg: .*less than or equal to 1"),
        ({"arm.tcp_load_centre_mm": [0, 0, 400]}, "tcp_load_centre_mm must be within 300 mm"),
        ({"arm.tcp_offset_mm_deg": [0, 0, 820, 0, 0, 0]}, "fingertips 820 mm from the flange"),
        ({"arm.tcp_offset_mm_deg": [0, 0, 82, 0, 0, 181]}, "within -180 and 180 degrees"),
        ({"arm.host": ""}, "arm.host: must be the control box's address"),
        ({"arm.host": "192.168.1. 150"}, "arm.host: must be the control box's address"),
        (
            {"controller.device": "keyboard", "headless": True},
            "device keyboard needs the window: leave out --headless",
        ),
        ({"controller.device": "a pedal"}, "controller.device: .*pattern"),
        (
            {"controller.mapping": {"wand": {}}},
            r"controller.mapping.wand: 'wand' is not one of vive",
        ),
        ({"seed": True}, "seed: must be a number .given: true.$"),
        ({"name": 7}, "name: must be text: write it in quotes .given: 7.$"),
        ({"cameras": {"eih": {"serial": 12345}}}, "cameras.eih.serial: must be text: write it"),
        (
            {"cameras": {"eih": {"source": "pattern", "exposure_us": 8000}}},
            "cameras.eih: exposure_us means nothing to a pattern camera: take it out",
        ),
        (
            {"cameras": {"eih": {"source": "file", "file": "a.mkv", "serial": "S"}}},
            "cameras.eih: serial means nothing to a file camera",
        ),
        (
            {"cameras": {"eih": {"source": "file", "file": "a.mkv", "name": "Webcam"}}},
            "cameras.eih: name means nothing to a file camera",
        ),
        (
            {"cameras": {"eih": {"name": "Webcam", "file": "a.mkv"}}},
            "cameras.eih: file means nothing to a v4l2 camera",
        ),
        (
            {"hand.rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]},
            "hand: rotation is mirrored .*one of its rows has the wrong sign",
        ),
        (
            {"hand.rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]},
            "hand: rotation must be orthonormal",
        ),
        (
            {"policy.allocation.static_weights": {"eih": 1.0}},
            "static_weights lacks gt, gs of video.views",
        ),
        ({"video.views": ["eih", "gt"]}, "policy.weights.matrix: 'gs' is not one of eih, gt"),
        ({"video.views": ["eih", "gt", "side"]}, "'gs' is not one of eih, gt, side"),
        ({"view.predict": "ehi"}, "'ehi' is not one of off, eih, all; did you mean eih"),
        ({"limits.box_min_mm": [0, 0, 500]}, "box_min_mm must be below box_max_mm"),
        ({"version": 2}, "version"),
        ({"video.views": ["eih", "gt", "gs", "eih"]}, "views must be different"),
        ({"video.quality": True}, "video.quality"),
        ({"networks.s2.rate_kbps": 1e-300}, "networks.s2.rate_kbps"),
    ],
)
def test_a_wrong_value_is_named_with_file_key_and_reason(overrides, sentence):
    with pytest.raises(ConfigError, match=f"(command line|{DEFAULT_CONFIG.name}): .*{sentence}"):
        load_config(None, overrides)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: [1", "is not valid YAML"),
        ("- 1\n- 2\n", "must hold keys and values"),
        ("version: 1\ninclude: [missing.yaml]\n", "missing.yaml: cannot be read"),
        ("version: 1\ninclude: 3\n", "include: must be a list"),
        ("version: 1\ninclude: [{a: 1}]\n", "include: must be a list of file names"),
        ("version: 1\ninclude: [bad.yaml]\n", "the file includes itself"),
        (
            "version: 1\nlimits:\n  floor_mm: 5\n  floor_mm: -500\n",
            "bad.yaml: line 4: floor_mm: is already given in line 3; keep one",
        ),
        ("version: 1\nversion: 1\n", "bad.yaml: line 2: version: is already given in line 1"),
        ("a: {b: 1, b: 2}\n", "bad.yaml: line 1: b: is already given in line 1"),
        ("a: 1\n'a': 2\n", "bad.yaml: line 2: a: is already given in line 1"),
        (
            "version: 1\ninclud: [networks.yaml, weights.yaml]\n",
            r"includ: no such key, did you mean include\? .given",
        ),
    ],
)
def test_an_unreadable_file_is_one_sentence(tmp_path, text, sentence):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=sentence) as caught:
        load_config(path)
    assert "\n" not in str(caught.value)


def test_everything_that_is_wrong_is_told_and_a_mistyped_key_first(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("version: 1\nseed: -1\nlimts: {floor_mm: 5}\nname: .nan\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path, {"seconds": -2})
    source, *problems = str(caught.value).split("; ")
    assert source == f"{path}: limts: no such key, did you mean limits?"
    assert "seed: must be greater than or equal to 0 (given: -1)" in problems
    assert "policy: is missing" in problems
    assert "`include: [weights.yaml]` brings ours" in problems
    assert "`include: [networks.yaml]` brings ours" in problems
    assert "command line: seconds: must be greater than 0 (given: -2)" in problems
    assert "more)" not in str(caught.value)


def test_every_key_says_what_it_means():
    unsaid = [
        f"{model.__name__}.{name}"
        for model in {model for _, model in all_sections(Config, "")}
        for name in model.model_fields
        if not meaning(model, name)
    ]
    assert unsaid == []


@pytest.mark.parametrize(
    ("key", "printed"),
    [
        ("networks.s1.latency_ms", "Unit: ms."),
        ("link", "| `lost_after_ms` |"),
        ("all", "## `arm.guard`"),
    ],
)
def test_a_key_a_section_and_all_of_them_are_explained(key, printed):
    assert printed in explain(key)


def test_a_key_that_is_none_is_not_explained():
    with pytest.raises(ConfigError, match=r"did you mean link\.lost_after_ms\?"):
        explain("link.lost_aftr_ms")


@pytest.mark.parametrize("value", [math.inf, -math.inf, NAN])
def test_no_number_of_the_configuration_may_be_infinite_or_none(value):
    accepted = []
    for model in {model for _, model in all_sections(Config, "")}:
        for name, field in model.model_fields.items():
            if float in (field.annotation, *get_args(field.annotation)):
                with pytest.raises(ValidationError) as caught:
                    model.model_validate({name: value})
                if not any(one["loc"] == (name,) for one in caught.value.errors()):
                    accepted.append(name)
    assert accepted == []


def test_the_configuration_is_found_in_a_checkout_and_where_it_is_installed(tmp_path):
    package = tmp_path / "tams_app"
    (tmp_path / "config").mkdir()
    assert find_config_directory(package) == package / "default_config"
    (tmp_path / "run_tams.py").touch()
    assert find_config_directory(package) == tmp_path / "config"


def test_calibrations_are_kept_beside_the_file_but_never_in_an_installed_package(tmp_path):
    mine, installed = tmp_path / "mine" / "tams.yaml", tmp_path / "default_config"
    assert writable_directory(mine, installed) == tmp_path / "mine"
    assert writable_directory(installed / "tams.yaml", installed) == Path("config")


def test_what_a_file_takes_over_from_an_anchor_it_may_replace(tmp_path):
    path = tmp_path / "anchor.yaml"
    path.write_text(
        f"include: [{DEFAULT_CONFIG}]\ncameras:\n"
        "  eih: &usual {serial: A, exposure_us: 8000}\n"
        "  gt: {<<: *usual, serial: B}\n"
        "  gs: {<<: *usual, serial: C}\n"
    )
    cameras = load_config(path).cameras
    assert [camera.serial for camera in cameras.values()] == ["A", "B", "C"]
    assert {camera.exposure_us for camera in cameras.values()} == {8000}


def test_a_stored_configuration_that_switches_parts_of_tams_plus_is_still_read(tmp_path):
    path = tmp_path / "stored.yaml"
    path.write_text(dump_config(load_config()).replace("\npolicy:\n", "\npolicy:\n" + REMOVED, 1))
    assert "lookahead" in path.read_text()
    assert load_config(path) == load_config()
    path.write_text(f"include: [{DEFAULT_CONFIG}]\npolicy:\n{REMOVED}  alocation: {{}}\n")
    with pytest.raises(ConfigError, match=r"did you mean policy\.allocation\?"):
        load_config(path)


def test_an_option_for_a_section_that_is_none_is_one_sentence(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("version: 1\npolicy: 3\n")
    with pytest.raises(ConfigError, match=r"bad\.yaml: policy: must hold keys and values"):
        load_config(path, {"policy.budget.mode": "oracle"})


@given(st.floats(0.001, 2), st.floats(0.1, 50), st.floats(1, 1000))
def test_the_stop_time_is_that_of_a_jerk_limited_ramp(speed, acceleration, jerk):
    """Integrate the ramp: jerk down to -a, hold, jerk back; the speed must end at zero."""
    total = stop_time_s(speed, acceleration, jerk)
    ramp = min(acceleration / jerk, total / 2)
    shed = jerk * ramp * (total - ramp)
    assert shed == pytest.approx(speed, rel=1e-6)
