"""`report ROBOT OPERATE`: one summary and one page of both sides' logs."""

from __future__ import annotations

import base64
import io
import json
import shutil
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tams_app.cli import _main
from tams_app.config import load_config
from tams_app.console.report import report_both, report_session
from tams_app.link.messages import OPERATOR_FOLDER_FACT, ROBOT_FOLDER_FACT
from tams_app.printing import Console
from tams_app.recording import LOG_NAME, Facts, SessionLog
from tams_app.recording.mcap_log import McapLog
from tams_app.records import EncodedFrame, Outcome, ShownFrame
from tams_app.session.viewing import viewers_of
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, VIEWS
from tests.test_summary_joined import HOUR_NS, pair

pytestmark = pytest.mark.untimed

ENDED_THERE = Outcome(True, None, None, None, "the robot's side: the trial is over")
FIRST_GREY, LATER_GREY = 60, 200  # of what is shown as the phase begins, and after its first second


def write(folder: Path, log: SessionLog, records: Iterable[Any]) -> Path:
    folder.mkdir()
    viewers = viewers_of(load_config(), log.header, live=False)
    with closing(McapLog(folder / LOG_NAME, log.header, True, *viewers)) as file:
        file.write(Facts(log.header.started_ns, log.facts), 0)
        for record in records:
            file.write(record, 0)
    return folder


def pictures() -> Iterable[ShownFrame]:
    """As the operator's side shows them, on a clock that is an hour less."""
    for at_s, grey in ((0.3, FIRST_GREY), (1.6, LATER_GREY)):
        for view in VIEWS:
            image = np.full((48, 64, 3), grey - 20, np.uint8)
            image[:24] = grey + 20
            shown_ns = START_NS - HOUR_NS + round(at_s * NS_PER_S)
            yield ShownFrame(view, 0, shown_ns, image, shown_ns, True)


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The folders of the robot's side and of the operator's."""
    tmp_path = tmp_path_factory.mktemp("sides")
    _, robot, operator = pair()
    operator.facts[ROBOT_FOLDER_FACT] = "robot"
    robot.facts[OPERATOR_FOLDER_FACT] = "operate"
    frames = [
        EncodedFrame(
            one.view,
            one.index,
            one.capture_ns,
            one.encoded_ns,
            one.keyframe,
            bytes(100),
            rtp_timestamp=one.rtp_timestamp,
        )
        for one in robot.sent
    ]
    records = (robot.ticks, robot.phases, robot.allocations, robot.captured, robot.hands_received)
    return (
        write(tmp_path / "robot", robot, [*(one for part in records for one in part), *frames]),
        write(
            tmp_path / "operate",
            operator,
            [*operator.states_received, *operator.shown, *pictures(), ENDED_THERE],
        ),
    )


@pytest.fixture
def sides(logged: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    """Copies of them."""
    robot, operate = (shutil.copytree(one, tmp_path / one.name) for one in logged)
    return robot, operate


@pytest.fixture(scope="module")
def joined(
    logged: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path, str]:
    """Both folders after a report that was given the operator's first, and what was printed."""
    there = tmp_path_factory.mktemp("joined")
    robot, operate = (shutil.copytree(one, there / one.name) for one in logged)
    output = io.StringIO()
    report_both(operate, robot, Console(file=output, width=80))
    return robot, operate, output.getvalue()


def test_all_is_written_into_the_folder_of_the_robots_side(joined: tuple[Path, Path, str]) -> None:
    robot, operate, _ = joined
    assert {one.name for one in robot.iterdir()} == {
        LOG_NAME,
        "summary.json",
        "bitrates.png",
        "report.html",
    }
    assert [one.name for one in operate.iterdir()] == [LOG_NAME]


def test_the_page_shows_what_was_shown_at_the_operators_side(
    joined: tuple[Path, Path, str],
) -> None:
    robot, *_ = joined
    page = (robot / "report.html").read_text(encoding="utf-8")
    coded = [part.partition('"')[0] for part in page.split('src="data:image/jpeg;base64,')[1:]]
    assert len(coded) == len(VIEWS)
    for one in coded:
        data = np.frombuffer(base64.b64decode(one), np.uint8)
        assert abs(float(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE).mean()) - FIRST_GREY) < 3


def last_line(folder: Path) -> tuple[str, str]:
    """All that is shown of a side's own log, and the command that its last line has."""
    output = io.StringIO()
    report_session(folder, Console(file=output, width=80))
    shown = output.getvalue()
    told, _, command = shown.splitlines()[-1].rpartition(": run_tams.py ")
    assert told.startswith("report on both sides")
    return shown, command


def test_of_the_robots_side_alone_what_was_shown_is_not_known_rather_than_nothing(
    sides: tuple[Path, Path], joined: tuple[Path, Path, str]
) -> None:
    alone, _ = last_line(sides[0])
    (row,) = (line for line in alone.splitlines() if line.startswith(VIEWS[0].upper()))
    assert " –/" in row
    assert "SSIM received" not in alone
    (row,) = (line for line in joined[2].splitlines() if line.startswith(VIEWS[0].upper()))
    assert " –/" not in row


@pytest.mark.parametrize("at", [0, 1], ids=["robot", "operate"])
def test_at_its_end_each_side_has_its_table_and_the_command_that_joins_the_two_logs(
    sides: tuple[Path, Path], at: int, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, operate = sides
    shown, command = last_line(sides[at])
    whole = " ".join(shown.split())
    for told in ("messages of the robot's side", "Frames shown"):
        assert (told in whole) == (at == 1)
    assert ("Control loop" in whole) == (at == 0)
    assert at == 0 or "the block is placed (the robot's side: the trial is over)" in whole
    assert "(replace " not in shown
    assert command.split() == ["report", str(robot), str(operate)]
    assert _main([*command.split(), "--json"]) == 0
    saved = (robot / "summary.json").read_text(encoding="utf-8")
    assert json.loads(capsys.readouterr().out) == json.loads(saved)


def test_of_a_folder_that_was_not_told_the_command_says_what_to_replace(tmp_path: Path) -> None:
    _, robot, operator = pair()  # sides of before folders were told
    of_robot = write(tmp_path / "robot", robot, robot.ticks)
    of_operator = write(tmp_path / "operate", operator, operator.states_received)
    for folder, unknown in ((of_robot, "FOLDER_OF_OPERATE"), (of_operator, "FOLDER_OF_ROBOT")):
        shown, command = last_line(folder)
        assert f"report on both sides (replace {unknown} by its folder, copied here): " in shown
        assert {*command.split()} == {"report", str(folder), unknown}


def test_the_operators_session_is_listed_with_how_it_ended(
    sides: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    _, operate = sides
    report_session(operate, Console(file=io.StringIO()))
    assert _main(["log", "list", str(operate.parent), "--json"]) == 0
    (listed,) = (
        one for one in json.loads(capsys.readouterr().out) if one["session"] == operate.name
    )
    assert listed["outcome"] == "the robot's side: the trial is over"
    assert listed["stops"] is None


def test_the_page_tells_of_the_link(joined: tuple[Path, Path, str]) -> None:
    robot, *_ = joined
    link = json.loads((robot / "summary.json").read_text(encoding="utf-8"))["link"]
    page = (robot / "report.html").read_text(encoding="utf-8")
    assert f"{link['samples']['counted']} of {link['samples']['heard']} samples counted" in page
    assert f"right to within {link['uncertainty_ms']:.1f} ms" in " ".join(page.split())
