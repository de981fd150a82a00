"""The files SteamVR reads, checked for their structure only: no SteamVR has seen them here."""

import json

import pytest

from hw.openvr.bindings import COMMITTED_DIRECTORY, MANIFEST_NAME, bindings, manifest, write
from hw.openvr.components import COMPONENTS, HANDS
from tams_app.config import ControllerConfig

pytestmark = pytest.mark.untimed

# What SteamVR's binding modes take as inputs.
INPUTS = {
    "trigger": {"pull", "click", "touch"},
    "button": {"click", "touch"},
    "joystick": {"click", "touch", "position"},
    "dpad": {"north", "south", "east", "west", "center"},
    "force_sensor": {"force"},
}
VALUE = {"pull": "vector1", "force": "vector1"}  # every other input is boolean
ACTION_TYPES = {action["name"]: action["type"] for action in manifest()["actions"]}


def committed(kind: str):
    path = COMMITTED_DIRECTORY / f"bindings_{kind}.json"
    return json.loads(path.read_text(encoding="utf-8"))


def sources(kind: str, config: ControllerConfig | None = None):
    return bindings(kind, config or ControllerConfig())["bindings"]["/actions/tams"]["sources"]


def outputs(kind: str, hand: str) -> set[str]:
    return {
        output["output"]
        for source in sources(kind)
        if source["path"].startswith(f"/user/hand/{hand}/")
        for output in source["inputs"].values()
    }


def test_the_committed_files_are_what_the_code_writes(tmp_path):
    write(tmp_path, ControllerConfig())
    written = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    there = {p.name: p.read_text(encoding="utf-8") for p in COMMITTED_DIRECTORY.glob("*.json")}
    assert there == written


def test_the_manifest_names_a_bindings_file_for_every_controller():
    listed = {b["controller_type"]: b["binding_url"] for b in manifest()["default_bindings"]}
    assert set(listed) == set(COMPONENTS)
    for kind, name in listed.items():
        assert (COMMITTED_DIRECTORY / name).is_file()
        assert committed(kind)["controller_type"] == kind


def test_actions_belong_to_the_one_action_set_and_have_a_type_steamvr_knows():
    (action_set,) = manifest()["action_sets"]
    assert action_set == {"name": "/actions/tams", "usage": "leftright"}
    for name, kind in ACTION_TYPES.items():
        direction = "out" if kind == "vibration" else "in"
        assert name.startswith(f"/actions/tams/{direction}/")
        assert len(name) < 64  # k_unMaxActionNameLength
        assert kind in ("boolean", "vector1", "vibration")


def test_every_action_has_a_label_for_the_operator():
    (texts,) = manifest()["localization"]
    assert set(texts) == {"language_tag", "/actions/tams", *ACTION_TYPES}


@pytest.mark.parametrize("kind", COMPONENTS)
def test_every_source_has_a_mode_and_inputs_and_outputs_that_go_together(kind):
    for source in sources(kind):
        assert source["path"].startswith(("/user/hand/left/input/", "/user/hand/right/input/"))
        assert source["inputs"]
        assert set(source["inputs"]) <= INPUTS[source["mode"]]
        for name, output in source["inputs"].items():
            assert ACTION_TYPES[output["output"]] == VALUE.get(name, "boolean")
    paths = [source["path"] for source in sources(kind)]
    assert len(paths) == len(set(paths))


@pytest.mark.parametrize("kind", COMPONENTS)
@pytest.mark.parametrize("hand", HANDS)
def test_every_hand_has_all_it_needs(kind, hand):
    needed = {f"/actions/tams/in/{name}" for name in ("trigger", "a", "b", "menu")}
    found = outputs(kind, hand)
    assert needed <= found
    assert len(found - needed) == 1  # one of the two grips
    assert (found - needed) <= {"/actions/tams/in/grip", "/actions/tams/in/grip_click"}


@pytest.mark.parametrize("kind", COMPONENTS)
def test_both_hands_feel_pulses_and_nothing_is_bound_to_the_system_button(kind):
    content = json.dumps(committed(kind))
    assert "/input/system" not in content
    for hand in HANDS:
        assert f"/user/hand/{hand}/output/haptic" in content


def test_the_wands_pad_must_be_pressed_not_just_touched():
    pads = [s for s in sources("vive_controller") if s["path"].endswith("/trackpad")]
    assert len(pads) == len(HANDS)
    assert all(pad["parameters"] == {"sub_mode": "click"} for pad in pads)


def test_a_mapping_of_ones_own_is_written_for_the_own_hand(tmp_path):
    mapping = {"vive_focus3_controller": {"menu": "application_menu/click"}}
    config = ControllerConfig.model_validate({"hand": "left", "mapping": mapping})
    path = write(tmp_path / "new", config)
    assert path.name == MANIFEST_NAME
    content = (tmp_path / "new" / "bindings_vive_focus3_controller.json").read_text()
    assert "/user/hand/left/input/application_menu" in content
    assert "/user/hand/left/input/joystick" not in content
    assert "/user/hand/right/input/joystick" in content
