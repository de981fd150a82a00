import pytest

from hw.openvr.components import configured_role_map, role_map
from tams_app.config import ControllerConfig
from tams_app.errors import ConfigError

pytestmark = pytest.mark.untimed


def test_x_and_y_play_a_and_b_on_the_left_focus_3():
    left = role_map("vive_focus3_controller", "left", {})
    right = role_map("vive_focus3_controller", "right", {})
    assert (left["a"].path, left["b"].path) == ("x/click", "y/click")
    assert (right["a"].path, right["b"].path) == ("a/click", "b/click")


def test_an_override_moves_one_role_only():
    default = role_map("vive_focus3_controller", "left", {})
    changed = role_map("vive_focus3_controller", "left", {"menu": "application_menu/click"})
    assert changed["menu"].path == "application_menu/click"
    assert {**changed, "menu": default["menu"]} == default


def test_two_roles_may_swap_their_components():
    roles = role_map("knuckles", "right", {"a": "b/click", "b": "a/click"})
    assert (roles["a"].path, roles["b"].path) == ("b/click", "a/click")


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        ({"a": "x/click"}, r"mapping\.vive_focus3_controller\.a: the right controller has no x/"),
        ({"menu": "a/click"}, "a/click cannot be both a and menu"),
        ({"a": "grip/pull", "grip": "a/click"}, "grip/pull is analog"),
        ({"trigger": "joystick/click", "menu": "a/click"}, "deadman must be analog"),
    ],
)
def test_a_mapping_that_cannot_be_is_refused_with_its_key(overrides, reason):
    with pytest.raises(ConfigError, match=reason):
        role_map("vive_focus3_controller", "right", overrides)


def test_overrides_are_meant_for_the_configured_hand_and_type():
    mapping = {"vive_controller": {"a": "trackpad/east"}}
    config = ControllerConfig.model_validate({"hand": "left", "mapping": mapping})
    assert configured_role_map("vive_controller", "left", config)["a"].path == "trackpad/east"
    assert configured_role_map("vive_controller", "right", config)["a"].path == "trackpad/south"
    assert configured_role_map("knuckles", "left", config)["a"].path == "a/click"


@pytest.mark.parametrize(
    "mapping",
    [
        {"vive_focus3_controller": {"menu": "system/click"}},
        {"vive_focus3_controller": {"menu": "nonsense"}},
        {"vive_focus3_controller": {"clutch": "a/click"}},
        {"oculus_touch": {"menu": "b/click"}},
    ],
)
def test_the_configuration_refuses_what_no_controller_could_do(mapping):
    with pytest.raises(ValueError):
        ControllerConfig.model_validate({"mapping": mapping})
