"""What viewers are shown of a session: its sentences, the arm in space, pictures and rates."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from hw.sim.layout import FIXED_VIEWPOINTS, WRIST_VIEWPOINT
from tams_app.config import load_config
from tams_app.recording import Recorder, read_log
from tams_app.recording.mcap_log import McapLog
from tams_app.records import (
    FrameQuality,
    MountPrediction,
    Note,
    Outcome,
    PacketArrival,
    PacketFate,
    PacketKind,
    PacketRecord,
    PolicyInputs,
    Pose,
    SceneTruth,
    ShownFrame,
    StopRecord,
    Twist,
    UplinkReport,
)
from tams_app.rotation import Rotation
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.session.viewing import viewers_of
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.foxglove_messages import messages, viewed_log, write_viewed_log
from tests.synthetic_session import START_NS, VIEWS, header, live_records, never_fails, tick

pytestmark = pytest.mark.waiting

INFO, WARNING, ERROR = 2, 3, 4  # foxglove.Log
Sent = dict[str, list[tuple[int, dict[str, Any]]]]


def recorded(tmp_path: Path, items: list[Any], **how: Any) -> Path:
    return write_viewed_log(tmp_path / "session.mcap", items, **how)


def sent(path: Path) -> Sent:
    found: Sent = defaultdict(list)
    for topic, log_time, content in messages(path):
        found[topic].append((log_time - header().wall_offset_ns, content))
    return found


def place(transform: dict[str, Any]) -> Pose:
    at, turn = transform["translation"], transform["rotation"]
    return Pose(
        np.array([at["x"], at["y"], at["z"]]),
        Rotation(turn["x"], turn["y"], turn["z"], turn["w"]),
    )


def test_notes_stops_and_the_verdict_are_log_lines_with_levels(tmp_path: Path) -> None:
    t = START_NS
    items = [
        Note(t, "info", "READY"),
        Note(t + 1, "warning", "no real-time priority"),
        StopRecord("pose frozen", t + 2, t + 2 + 48 * NS_PER_MS),
        StopRecord("stale video", t + 3, None),
        Note(t + 4, "error", "a camera is gone"),
        Outcome(True, True, 41.26, 1, "the trial is over"),
    ]
    lines = [
        (at, line["level"], line["message"]) for at, line in sent(recorded(tmp_path, items))["/log"]
    ]
    assert lines[:5] == [
        (t, INFO, "READY"),
        (t + 1, WARNING, "no real-time priority"),
        (t + 2, ERROR, "stop, pose frozen: at rest after 48 ms"),
        (t + 3, ERROR, "stop, stale video: the session ended before the arm was seen at rest"),
        (t + 4, ERROR, "a camera is gone"),
    ]
    assert lines[5][1:] == (
        INFO,
        "completed in 41.3 s, 1 drops, a success: the trial is over",
    )


def test_the_links_stand_where_the_reported_joints_put_them(tmp_path: Path) -> None:
    config = load_config(None, {})
    found = sent(recorded(tmp_path, [tick(0)]))
    ((_, message),) = found["/tf"]
    places = {one["child_frame_id"]: place(one) for one in message["transforms"]}
    assert all(one["parent_frame_id"] == "base" for one in message["transforms"])
    arm = tick(0).arm
    assert np.allclose(places["tcp"].position, arm.tcp.position)
    offset = offset_from_mm_deg(config.arm.tcp_offset_mm_deg)
    flange = places["link6"]
    tcp = Lite6Model(offset).tcp_pose(arm.joints)
    assert np.allclose(flange.position + flange.rotation.apply(offset.position), tcp.position)
    ((_, joints),) = found["/joints"]
    angles = {one["name"]: one["position"] for one in joints["joints"]}
    assert list(angles) == [f"joint{number}" for number in range(1, 7)]
    assert np.allclose(list(angles.values()), arm.joints)


def test_every_frame_that_something_is_drawn_in_is_placed(tmp_path: Path) -> None:
    pose = Pose(np.array([0.3, 0.0, 0.01]), Rotation.identity())
    found = sent(recorded(tmp_path, [tick(0), SceneTruth(START_NS, pose, pose, pose, 0.0, 0.016)]))
    placed = {
        one["child_frame_id"]
        for topic in ("/tf", "/tf/things", "/tf_static")
        for _, message in found[topic]
        for one in message["transforms"]
    } | {"base"}
    drawn = {
        entity["frame_id"]
        for topic in ("/scene/robot", "/scene/things", "/scene/workspace")
        for _, message in found[topic]
        for entity in message["entities"]
    }
    assert {"base", "link1", "link6", "block", "container"} <= drawn <= placed
    posed = {found[topic][0][1]["frame_id"] for topic in ("/pose/hand", "/pose/commanded")}
    assert posed == {"tracking", "base"}
    lenses = {
        message["frame_id"] for view in VIEWS for _, message in found[f"/camera/{view}/calibration"]
    }
    assert lenses == set(VIEWS)
    assert posed | lenses <= placed


def test_where_the_flange_is_predicted_is_a_frame_of_its_own(tmp_path: Path) -> None:
    was = Pose(np.array([0.3, 0.0, 0.2]), Rotation.identity())
    now = Pose(np.array([0.32, 0.0, 0.2]), Rotation.identity())
    led = Pose(np.array([0.35, 0.0, 0.2]), Rotation.identity())
    told = [
        MountPrediction(START_NS, was, START_NS + number * NS_PER_S // 60, now, commanded=led)
        for number in range(61)
    ]
    sent_there = sent(recorded(tmp_path, told))["/tf/predicted"]
    assert len(sent_there) == pytest.approx(31, abs=1), "at a viewer's pace"
    frames = sent_there[0][1]["transforms"]
    assert [one["parent_frame_id"] for one in frames] == ["base", "base"]
    assert [one["child_frame_id"] for one in frames] == ["flange predicted", "flange commanded"]
    assert np.allclose(place(frames[0]).position, now.position)
    assert np.allclose(place(frames[1]).position, led.position)


def test_the_commanded_pose_is_where_the_twist_leads(tmp_path: Path) -> None:
    first = replace(tick(0), twist=Twist((0.2, 0.0, -0.1), (0.0, 0.0, 0.5)))
    found = sent(recorded(tmp_path, [first]))
    deadman_s = load_config(None, {}).arm.velocity_deadman_s
    poses = [message["pose"] for _, message in found["/pose/commanded"]]
    expected = first.arm.tcp.position + np.array([0.2, 0.0, -0.1]) * deadman_s
    assert np.allclose(list(poses[0]["position"].values()), expected)
    turned = first.arm.tcp.rotation.turn_to(Rotation(**poses[0]["orientation"]))
    assert math.isclose(float(np.linalg.norm(turned)), 0.5 * deadman_s, rel_tol=1e-6)


def test_hand_and_arm_are_sent_at_most_thirty_times_a_second(tmp_path: Path) -> None:
    found = sent(recorded(tmp_path, [tick(number) for number in range(241)]))
    for topic in ("/tf", "/joints", "/pose/hand", "/pose/commanded"):
        assert 59 <= len(found[topic]) <= 61, topic
    assert len(found["/tick"]) == 241


def test_a_lens_projects_as_the_rig_renders(tmp_path: Path) -> None:
    found = sent(recorded(tmp_path, [tick(0)]))
    still = {one["child_frame_id"]: one for one in found["/tf_static"][0][1]["transforms"]}
    assert still["eih"]["parent_frame_id"] == "link6"
    for view, viewpoint in {**FIXED_VIEWPOINTS, "eih": WRIST_VIEWPOINT}.items():
        ((_, lens),) = found[f"/camera/{view}/calibration"]
        top = math.degrees(math.atan2(lens["height"] / 2, lens["K"][4]))
        assert math.isclose(top, viewpoint.fovy_deg / 2)
        assert np.allclose(place(still[view]).rotation.as_matrix(), viewpoint.axes)
    viewpoint = FIXED_VIEWPOINTS["gt"]
    pose = place(still["gt"])
    ahead = np.add(viewpoint.place, viewpoint.axes[:, 2])
    seen = pose.rotation.inv().apply(ahead - pose.position)
    matrix = np.reshape(found["/camera/gt/calibration"][0][1]["P"], (3, 4))
    x, y, depth = matrix @ [*seen, 1.0]
    assert (x / depth, y / depth) == pytest.approx(
        (319.5, 239.5)
    )  # whole numbers are the middle of a pixel


def picture(index: int) -> np.ndarray[Any, Any]:
    image = np.zeros((240, 320, 3), np.uint8)
    cv2.putText(image, str(index), (20, 180), cv2.FONT_HERSHEY_SIMPLEX, 5, (80, 220, 255), 12)
    return cv2.GaussianBlur(image, (5, 5), 0)


def shown_frames(seconds: int) -> list[ShownFrame]:
    return [
        ShownFrame(view, index, START_NS + index * NS_PER_S // 30, picture(index), START_NS, True)
        for index in range(seconds * 30)
        for view in VIEWS
    ]


def test_wherever_one_looks_each_view_has_a_picture_as_shown_within_half_a_second(
    tmp_path: Path,
) -> None:
    frames = shown_frames(4)
    found = sent(recorded(tmp_path, frames))
    for view in VIEWS:
        by_time = {one.shown_ns: one for one in frames if one.view == view}
        times = [at for at, _ in found[f"/shown/{view}"]]
        assert times[0] == START_NS
        assert max(np.diff([*times, START_NS + 4 * NS_PER_S])) <= 500 * NS_PER_MS
        for at, message in found[f"/shown/{view}"]:
            assert message["format"] == "jpeg"
            image = cv2.imdecode(np.frombuffer(message["data"], np.uint8), cv2.IMREAD_COLOR)
            assert cv2.PSNR(image, by_time[at].image) > 30
    assert len(read_log(tmp_path / "session.mcap").shown) == len(frames)


def test_a_live_log_has_the_same_pictures(tmp_path: Path) -> None:
    path = tmp_path / "live.mcap"
    viewers = viewers_of(load_config(), header(), live=False)
    live = Recorder(McapLog(path, header(), True, *viewers), MonotonicClock(), never_fails)
    live.start()
    for frame in shown_frames(2):
        live.record(frame)
    live.close()
    direct = sent(recorded(tmp_path, shown_frames(2)))
    found = sent(path)
    for view in VIEWS:
        assert found[f"/shown/{view}"] == direct[f"/shown/{view}"] != []


def test_what_is_switched_off_is_not_there(tmp_path: Path) -> None:
    items = [tick(0), *shown_frames(1)]
    without_pictures = {"recording.pictures_per_s": 0}
    topics = set(sent(recorded(tmp_path, items, **without_pictures)))
    assert "/tf" in topics
    assert not any(topic.startswith("/shown/") for topic in topics)
    (tmp_path / "session.mcap").unlink()
    without = sent(recorded(tmp_path, items, **{"recording.viewers": False}))
    assert set(without) == {"/header", "/tick", "/frames/shown"}


def test_the_rates_of_a_second_are_what_was_sent_shown_and_scored(tmp_path: Path) -> None:
    t = START_NS
    scores = [
        FrameQuality("eih", index, t, t, 0, False, False, 0.9, 0.9, live)
        for index, live in enumerate((0.7, 0.8, None))
    ]
    lost = [
        PacketRecord("gt", PacketKind.MEDIA, 0, 1000, t, 0, 0, PacketFate.OVERFLOW),
        PacketRecord("gt", PacketKind.PADDING, 0, 1000, t, t + 1, t + 2, PacketFate.DELIVERED),
        PacketRecord("gt", PacketKind.RTCP, 0, 80, t, t + NS_PER_S, 0, PacketFate.LOST),
    ]
    items = [*scores, *lost, *live_records(1.0)]
    path, clock = tmp_path / "session.mcap", VirtualClock(t)
    with closing(viewed_log(path, header(), clock)) as log:
        for item in items:
            log.record(item)
        clock.advance_ns(NS_PER_S)
        log.record(tick(0))
    ((at, rates),) = sent(path)["/rates"]
    assert at == t + NS_PER_S
    assert (rates["budget_kbps"], rates["capacity_kbps"]) == (5520.0, 6000.0)
    assert rates["queue_ms"] == pytest.approx(8.0)
    views = {one["view"]: one for one in rates["views"]}
    of_gt = [one for one in live_records(1.0) if isinstance(one, PacketRecord) and one.view == "gt"]
    sent_bytes = sum(one.size_bytes for one in of_gt)
    assert views["gt"]["sent_kbps"] == pytest.approx((sent_bytes + 1000) * 8 / 1000)
    assert views["gt"]["loss"] == pytest.approx(1 / (len(of_gt) + 1)), "of the media packets"
    assert views["gt"]["target_kbps"] == 2000
    assert rates["target_kbps"] == 5000
    total_kbps = sum(one["sent_kbps"] for one in views.values())
    assert rates["sent_kbps"] == pytest.approx(total_kbps + 8 + 0.64), "padding and RTCP"
    assert views["eih"]["captured_fps"] == views["eih"]["shown_fps"] == 30
    assert views["eih"]["latency_ms"] == pytest.approx(60)
    assert views["eih"]["live_ssim"] == pytest.approx(0.75)
    assert views["eih"]["received_ssim"] == pytest.approx(0.9)
    assert views["gs"]["live_ssim"] is None


def test_the_rates_of_a_real_network_are_what_receivers_tell(tmp_path: Path) -> None:
    t = START_NS
    came = [PacketArrival("gt", t + number, 1000, number + 9 * NS_PER_MS) for number in range(9)]
    late = PacketArrival("gt", t + 10, 1000, 10 + 30 * NS_PER_MS)
    lost = PacketArrival("eih", t + 11, 500, None)
    told = PolicyInputs.of(UplinkReport(t, 10_500, (*came, late, lost)))
    path = recorded(tmp_path, [told, tick(0)], apart_ns=NS_PER_S)
    ((_at, rates),) = sent(path)["/rates"]
    assert rates["sent_kbps"] == pytest.approx(84.0)
    assert rates["loss"] == pytest.approx(1 / 11)
    assert rates["queue_ms"] == pytest.approx(21.0)
    views = {one["view"]: one for one in rates["views"]}
    assert views["gt"]["sent_kbps"] == pytest.approx(80.0)
    assert views["eih"]["loss"] == 1.0
    assert (views["gs"]["sent_kbps"], views["gs"]["loss"]) == (0.0, None)


def test_the_same_records_make_the_same_bytes(tmp_path: Path) -> None:
    items = [*live_records(1.0), *shown_frames(1)]
    files = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        files.append(recorded(tmp_path / name, items).read_bytes())
    assert files[0] == files[1]


def test_every_field_of_our_own_messages_says_what_it_is(tmp_path: Path) -> None:
    path = recorded(tmp_path, [tick(0), tick(1)], apart_ns=NS_PER_S)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    own = [one for one in summary.schemas.values() if one.encoding == "jsonschema"]
    assert {one.name for one in own} >= {"Header", "Tick", "Rates"}
    for schema in own:
        for name, part in json.loads(schema.data)["properties"].items():
            assert part["description"], (schema.name, name)
    described = json.loads(next(one.data for one in own if one.name == "Tick"))["properties"]
    assert "[m/s]" in described["speed"]["description"]
    assert "[rad]" in described["arm"]["properties"]["joints"]["description"]
