"""A camera on the arm that is not where its calibration has it: the picture alone is worse."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tams_app.config import Config, Network
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import Pose
from tams_app.rotation import Rotation
from tams_app.session import predicting
from tams_app.session.viewing import scene_of
from tams_app.station.mount_memory import misfit
from tams_app.summary.summarise import summarise
from tams_app.telemetry import Scene
from tests.session.virtual.runs import run, short

pytestmark = [pytest.mark.untimed, pytest.mark.timeout(600)]

OF_THE_PICTURE = {"/prediction", "/note", "/log"}
LOOKS = {"rig.operator.looks_at": "received", "video.quality.enabled": False}


def rolled(config: Config) -> Scene:
    """The surroundings, with the wrist's camera turned by 30 degrees about its axis."""
    scene = scene_of(config)
    lens = scene.lenses["eih"]
    turned = lens.pose.rotation * Rotation.from_rotvec((0.0, 0.0, 0.52))
    wrong = replace(lens, pose=Pose(lens.pose.position, turned))
    return replace(scene, lenses={**scene.lenses, "eih": wrong})


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same trial by the right camera and a wrong one; the operator looks past the picture."""
    found = {}
    for name in ("right", "wrong"):
        found[name] = tmp_path_factory.mktemp(name)
        with pytest.MonkeyPatch.context() as patch:
            if name == "wrong":
                patch.setattr(predicting, "scene_of", rolled)
            run(short(network="s2", seconds=12.0, **{"view.predict": "all"}, **LOOKS), found[name])
    return found


@pytest.fixture(scope="module")
def logs(folders: dict[str, Path]) -> dict[str, SessionLog]:
    return {name: read_log(folder / LOG_NAME) for name, folder in folders.items()}


def messages(folder: Path) -> dict[str, list[tuple[int, bytes]]]:
    """All that a log has, to the bit, by topic."""
    found = defaultdict(list)
    with (folder / LOG_NAME).open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            found[channel.topic].append((message.log_time, message.data))
    return found


def test_all_that_moves_or_stops_the_arm_is_the_same_to_the_bit(
    folders: dict[str, Path], logs: dict[str, SessionLog]
) -> None:
    right, wrong = (messages(folder) for folder in folders.values())
    assert right.keys() == wrong.keys()
    assert {topic for topic in right if right[topic] != wrong[topic]} == OF_THE_PICTURE
    assert len(logs["wrong"].ticks) > 1000
    assert {tick.arming for tick in logs["wrong"].ticks} >= {"ready", "engaged"}


def test_it_is_found_said_once_and_the_frames_are_shown_as_received_from_then_on(
    logs: dict[str, SessionLog],
) -> None:
    said = [note for note in logs["wrong"].notes if note.text == misfit("eih")]
    assert [note.level for note in said] == ["warning"]
    for one in logs["wrong"].predictions:
        assert one.camera_fits == (one.now_ns <= said[0].t_ns)
    believed = (
        [(one.now_ns, *one.now.position, *one.now.rotation) for one in log.predictions]
        for log in logs.values()
    )
    assert next(believed) == next(believed)
    assert misfit("eih") not in [note.text for note in logs["right"].notes]
    assert all(one.camera_fits for one in logs["right"].predictions)


def test_the_summary_says_so_and_where_quality_is_off_no_frame_is_scored(
    logs: dict[str, SessionLog],
) -> None:
    assert logs["right"].shown
    assert logs["right"].quality == []
    fits = {name: summarise(log)["prediction"]["camera_fits"] for name, log in logs.items()}
    assert fits == {"right": True, "wrong": False}


@pytest.mark.verify
@pytest.mark.parametrize("latency_ms", [40.0, 400.0])
@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
def test_the_right_camera_is_never_found_wrong(
    tmp_path: Path, seed: int, latency_ms: float
) -> None:
    network = Network(latency_ms=latency_ms, rate_kbps=12_000.0)
    given = {"networks.case": network.model_dump(), "view.predict": "eih", **LOOKS}
    run(short(seed=seed, network="case", seconds=20.0, **given), tmp_path)
    log = read_log(tmp_path / LOG_NAME)
    assert len(log.predictions) > 500
    assert all(one.camera_fits for one in log.predictions)
