"""The layout for Foxglove fits the log: checked without the application, which needs a network."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import foxglove.layouts as sdk
import numpy as np
import pytest

from tams_app import palette
from tams_app.config import load_config
from tams_app.config.yaml_file import CONFIG_DIRECTORY
from tams_app.records import FrameQuality, Note, Pose, SceneTruth
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS
from tests.foxglove_messages import messages, write_viewed_log
from tests.synthetic_session import START_NS, VIEWS, live_records
from tests.telemetry.test_telemetry import shown_frames

pytestmark = pytest.mark.waiting

LAYOUT = json.loads((CONFIG_DIRECTORY / "foxglove" / "tams.json").read_text(encoding="utf-8"))
PANELS: dict[str, dict[str, Any]] = LAYOUT["configById"]
# An exported layout names a panel's type before the "!"; the SDK documents what it may say.
KINDS: dict[str, Any] = {
    "3D": sdk.ThreeDeeConfig,
    "Image": sdk.ImageConfig,
    "Plot": sdk.PlotConfig,
    "StateTransitions": sdk.StateTransitionsConfig,
    "RosOut": sdk.LogConfig,
}
SERIES = {"Plot": sdk.PlotSeries, "StateTransitions": sdk.StateTransitionsSeries}
TITLE = "foxglovePanelTitle"

Contents = dict[str, list[dict[str, Any]]]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Contents:
    """What each topic of a session's log says."""
    path = tmp_path_factory.mktemp("log") / "session.mcap"
    pose = Pose(np.array([0.3, 0.0, 0.01]), Rotation.identity())
    items = [
        Note(START_NS, "info", "READY"),
        SceneTruth(START_NS, pose, pose, pose, 0.0, 0.016),
        *shown_frames(1),
        *(FrameQuality(view, 0, 0, 0, 0, False, False, 0.9, 0.9, 0.8) for view in VIEWS),
        *live_records(1.0),
    ]
    found: Contents = {}
    for topic, _, content in messages(write_viewed_log(path, items, 2 * NS_PER_MS)):
        found.setdefault(topic, []).append(content)
    return found


def placed(tree: Any) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    else:
        assert set(tree) == {"direction", "first", "second", "splitPercentage"}
        assert tree["direction"] in ("row", "column")
        yield from placed(tree["first"])
        yield from placed(tree["second"])


def test_each_panel_has_one_place_and_a_type_that_foxglove_documents() -> None:
    assert sorted(placed(LAYOUT["layout"])) == sorted(PANELS)
    kinds = [name.split("!")[0] for name in PANELS]
    assert set(kinds) == set(KINDS)
    assert kinds.count("Image") == 3


@pytest.mark.parametrize("panel", PANELS)
def test_a_panel_says_nothing_that_foxglove_does_not_document(panel: str) -> None:
    kind, config = panel.split("!")[0], PANELS[panel]
    assert set(config) - {TITLE} <= set(KINDS[kind]()._to_dict())
    for one in config.get("paths", ()):
        assert set(one) <= set(SERIES[kind]()._to_dict())
    if kind == "Image":
        assert set(config["imageMode"]) <= set(sdk.ImageModeConfig()._to_dict())


def test_the_topics_that_are_drawn_are_in_a_log(log: Contents) -> None:
    for panel, config in PANELS.items():
        mode = config.get("imageMode", {})
        drawn = {*config.get("topics", {}), mode.get("imageTopic"), mode.get("calibrationTopic")}
        drawn.add(config.get("topicToRender"))
        assert drawn - {None} <= set(log), panel
    frames = {one["parent_frame_id"] for message in log["/tf"] for one in message["transforms"]}
    assert PANELS["3D!scene"]["followTf"] in frames


_STEP = re.compile(r'\.(?P<field>\w+)|(?P<each>\[:\])|\{(?P<key>\w+)=="(?P<value>[^"]*)"\}')


def values(path: str, log: Contents) -> list[Any]:
    """What a message path stands for (Foxglove's documentation, message path syntax)."""
    topic = re.match(r"(/\w+)+", path)
    assert topic, path
    found: list[Any] = list(log[topic[0]])
    at = topic.end()
    while at < len(path):
        step = _STEP.match(path, at)
        assert step, path
        if step["field"]:
            found = [one[step["field"]] for one in found if one is not None]
        elif step["each"]:
            found = [item for one in found for item in one]
        else:
            found = [one for one in found if one[step["key"]] == step["value"]]
        at = step.end()
    return found


PATHS = [one["value"] for config in PANELS.values() for one in config.get("paths", ())]


@pytest.mark.parametrize("path", PATHS)
def test_each_path_of_a_plot_leads_to_values_in_a_log(path: str, log: Contents) -> None:
    found = values(path, log)
    assert found
    if path.startswith(("/rates", "/frames")):
        assert any(isinstance(one, float | int) for one in found), path


COLOURED = [one for config in PANELS.values() for one in config.get("paths", ()) if "color" in one]
UPLINK = {
    "/rates.capacity_kbps": palette.EMULATED_CAPACITY,
    "/rates.estimate_kbps": palette.CAPACITY_ESTIMATE,
    "/rates.budget_kbps": palette.UPLINK_BUDGET,
    "/rates.target_kbps": palette.UPLINK_SENT,
    "/rates.sent_kbps": palette.UPLINK_SENT,
    "/rates.queue_ms": palette.UPLINK_SENT,
    "/rates.loss": palette.UPLINK_SENT,
}


def test_each_series_of_a_view_has_the_colour_of_that_view() -> None:
    views = load_config(None, {}).video.views
    found = [(re.search(r'view=="(\w+)"', one["value"]), one["color"]) for one in COLOURED]
    of_views = [(view[1], colour) for view, colour in found if view]
    assert {view for view, _ in of_views} == set(views)
    for view, colour in of_views:
        assert colour == palette.view_colour(views.index(view)), view


def test_each_series_of_the_uplink_has_a_colour_of_the_uplink() -> None:
    found = {one["value"]: one["color"] for one in COLOURED if "view==" not in one["value"]}
    assert found == UPLINK


def test_what_a_lab_asks_first_is_on_the_screen() -> None:
    shown = " ".join(PATHS)
    for name in ("target_kbps", "sent_kbps", "budget", "capacity", "latency", "queue", ".live"):
        assert name in shown
    assert {"/tick.phase", "/tick.arming"} <= set(PATHS)


def test_the_layout_is_installed_with_the_configuration() -> None:
    assert (Path(CONFIG_DIRECTORY) / "foxglove" / "tams.json").is_file()
    project = (CONFIG_DIRECTORY.parent / "pyproject.toml").read_text(encoding="utf-8")
    assert '"foxglove/*"' in project
