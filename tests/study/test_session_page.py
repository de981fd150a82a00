"""report.html: what it shows is what the log says, and it needs no other file."""

from __future__ import annotations

import base64
import re
import shutil
from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from html import unescape
from pathlib import Path

import cv2
import numpy as np
import pytest

from tams_app import palette
from tams_app.cli import _main
from tams_app.console.report import PAGE_NAME, write_summary
from tams_app.recording import FrameSent, SessionLog, read_log, reader
from tams_app.recording.reader import ShownPicture, read_pictures
from tams_app.records import Episode, FrameQuality, Note, Phase, PhaseChange, ShownFrame, StopRecord
from tams_app.report.figures import held_stretches, timeline_figure
from tams_app.report.plots import THEME, to_svg
from tams_app.report.session_page import stills_of, write_page
from tams_app.runtime.clock import VirtualClock
from tams_app.summary import summarise
from tams_app.summary.tables import LogTables
from tams_app.teleop.hands import HANDS
from tams_app.teleop.reasons import Reason
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.foxglove_messages import viewed_log
from tests.synthetic_session import START_NS, VIEWS, Synthetic, header, tick

pytestmark = pytest.mark.untimed

GREYS = (40, 120, 200)  # of the pictures of each phase


def second(t_s: float) -> int:
    return START_NS + round(t_s * NS_PER_S)


def picture(grey: int, contrast: int = 20) -> np.ndarray:
    """A picture of two halves, shape (48, 64, 3), whose mean is `grey`."""
    image = np.full((48, 64, 3), grey - contrast, np.uint8)
    image[:24] = grey + contrast
    return image


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds in three phases, with two stops, a note, and pictures in a grey of each."""
    path = tmp_path_factory.mktemp("sessions") / "20260101-100000-run"
    path.mkdir()
    clock = VirtualClock(START_NS)
    phases = (Phase.REACH, Phase.ALIGN, Phase.PRE_RELEASE)
    with closing(viewed_log(path / "session.mcap", header(), clock)) as log:
        for number, (phase, grey) in enumerate(zip(phases, GREYS, strict=True)):
            log.record(PhaseChange(second(number), phase, "a rule"))
            for view in VIEWS:
                shown_ns, capture_ns = second(number + 0.2), second(number + 0.1)
                image = picture(grey)
                log.record(ShownFrame(view, 30 * number, shown_ns, image, capture_ns, True))
            for at in range(120 * number, 120 * (number + 1)):
                log.record(tick(at))
            clock.advance_ns(NS_PER_S)
        log.record(StopRecord("stale video", second(1.5), second(1.5) + 80 * NS_PER_MS))
        log.record(StopRecord("arm error: C31 (<collision>)", second(2.5), None))
        log.record(Note(second(1.5), "warning", "hold, stale video."))
    return path


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    write_summary(folder)
    return (folder / PAGE_NAME).read_text(encoding="utf-8")


def written(log: SessionLog, folder: Path, pictures: Iterable[ShownPicture] = ()) -> str:
    """The page of a log with these pictures."""
    write_page(LogTables(log), summarise(log), pictures, folder / "other.html")
    return (folder / "other.html").read_text(encoding="utf-8")


def rows_of(page: str, begin: str = "<tr>") -> list[list[str]]:
    """The words of each part of a page that begins so."""
    return [re.sub(r"<[^>]+>", " ", part).split() for part in page.split(begin)]


def test_the_page_needs_no_other_file(page: str) -> None:
    sources = re.findall(r'\b(?:src|href|data|srcset)=["\']?([^"\'\s>]+)', page)
    assert sources
    assert [one for one in sources if not one.startswith(("data:image/", "#"))] == []
    assert "@import" not in page
    assert re.findall(r"url\((?!#)", page) == []
    assert "<script" not in page


def test_each_stop_is_told_with_its_time_and_what_to_do(page: str) -> None:
    text = unescape(page)
    assert Reason.STALE_VIDEO.sentence(HANDS["openvr"]) in text
    assert Reason.ARM_ERROR.sentence(HANDS["openvr"]) in text
    assert "arm error: C31 (&lt;collision&gt;)" in page
    (stale,) = (row for row in rows_of(page) if row[2:4] == ["stale", "video"])
    assert stale[:2] == ["1", "1.50"]
    assert stale[4] == "80"


def test_each_episode_is_told_with_its_verdict_and_label_and_a_session_without_has_no_table(
    folder: Path, page: str
) -> None:
    assert "Episodes" not in page
    log = read_log(folder / "session.mcap")
    log.episodes = [
        Episode(second(1), 1, second(0.5), second(1), False),
        Episode(second(2), 2, second(1.5), second(2), True, True),
    ]
    told = written(log, folder)
    rows = rows_of(told)
    assert ["1", "0.50", "0.5", "discarded"] in rows
    assert ["2", "1.50", "0.5", "kept", "success"] in [row[:5] for row in rows]
    tiles = rows_of(told, "<div><dt>")
    assert ["Episodes", "1", "kept", "1", "discarded"] in tiles
    assert not [tile for tile in tiles if tile[:1] == ["Outcome"]]
    for numbered in ("Episodes", "Stops"):  # whose numbers name their rows, below their heading
        _, _, table = told.partition(f"<h2>{numbered}</h2>")
        head, _, body = table.partition("</thead>")
        assert re.findall(r"<th scope=\"col\"[^>]*>([^<]+)", head)[0] == "No."
        assert '<tr><th scope="row">1</th>' in body.partition("</table>")[0]


def test_every_phase_is_named_and_shown_as_it_began(folder: Path, page: str) -> None:
    for name in ("Reach", "Align", "Pre-Release"):
        assert f"<strong>{name}</strong>" in page
    path = folder / "session.mcap"
    stills = stills_of(read_log(path), read_pictures(path))
    for still, grey in zip(stills, GREYS, strict=True):
        assert [one.view for one in still.pictures] == list(VIEWS)
        for one in still.pictures:
            data = np.frombuffer(base64.b64decode(one.source.partition(",")[2]), np.uint8)
            assert abs(float(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE).mean()) - grey) < 3
    assert page.count('class="primary"') == 3


def test_a_still_is_the_first_picture_with_something_in_it_and_a_view_without_is_named() -> None:
    log = Synthetic(6.0, switch_s=3.0).log()

    def shown(view: str, t_s: float, grey: int, contrast: int) -> ShownPicture:
        wall_ns = second(t_s) + log.header.wall_offset_ns
        return ShownPicture(
            view, wall_ns, cv2.imencode(".jpg", picture(grey, contrast))[1].tobytes()
        )

    reach, align = stills_of(
        log,
        [
            shown("eih", 0.1, 131, 0),  # an encoder's first frame at its lowest rate
            shown("gt", 0.2, 131, 0),
            shown("eih", 1.4, 90, 20),
            shown("eih", 1.9, 200, 20),
            ShownPicture("gs", second(3.1) + log.header.wall_offset_ns, b"no picture"),
        ],
    )
    (still,) = reach.pictures
    assert (still.view, round(still.t_s, 3)) == ("eih", 1.4)
    assert reach.missing == ("gt", "gs")
    assert (align.pictures, align.missing) == ((), VIEWS)


def test_a_view_without_a_picture_is_named_on_the_page_and_a_log_without_any_too(
    folder: Path,
) -> None:
    path = folder / "session.mcap"
    log, pictures = read_log(path), list(read_pictures(path))
    assert len(pictures) == 9
    page = written(log, folder, [one for one in pictures if one.view == "eih"])
    assert "the log has no picture of GT, GS from this phase." in " ".join(page.split())
    assert "has no pictures as they were shown" in written(log, folder)


def test_the_key_numbers_stand_at_the_top(page: str) -> None:
    text = re.sub(r"<[^>]+>", "|", page[: page.index("<h2>")])

    found = [part for part in text.split("|") if part.strip()]
    for name, value in (("Outcome", "Not judged"), ("Completion time", "–"), ("Stops", "2")):
        assert found[found.index(name) + 1] == value
    assert found[found.index("Stops") + 2] == "longest to rest 80 ms"
    assert found[found.index("Late ticks") + 1] == "0.00 %"
    for name in ("SSIM, primary view", "Capture to screen", "Freezes", "Uplink"):
        assert name in found


def test_the_page_and_its_plot_follow_a_dark_scheme(page: str) -> None:
    assert "@media screen and (prefers-color-scheme: dark)" in page
    plot = page[page.index("<svg") : page.index("</svg>")]
    for name, (light, dark) in THEME.items():
        assert f"--{name}: {light};" in page
        assert f"--{name}: {dark};" in page
        assert light not in plot
    assert "var(--ink)" in plot
    assert "var(--stop)" in plot


def test_words_of_a_plot_can_be_searched_and_it_names_no_address() -> None:
    plot = str(to_svg(timeline_figure(LogTables(Synthetic(6.0, switch_s=3.0).log()))))
    assert ">Time since session start [s]</text>" in plot
    assert "http" not in plot


def test_no_name_in_one_plot_is_a_name_in_another() -> None:
    names = [
        set(re.findall(r' id="([^"]+)"', str(to_svg(timeline_figure(LogTables(log))))))
        for log in (Synthetic(6.0).log(), Synthetic(3.0, switch_s=1.0).log())
    ]
    assert names[0]
    assert not any(name.endswith(("_1", "_2")) for found in names for name in found)


def test_notes_are_told_with_their_levels(page: str) -> None:
    assert '<td class="words sentence warning">hold, stale video.</td>' in page


@pytest.mark.parametrize(
    "kind", [b'x" onerror="alert(document.domain)', b"\xff", b"svg+xml", b"\x1b[2J", b""]
)
def test_a_picture_that_is_no_jpeg_is_refused_in_one_sentence(
    tmp_path: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kind: bytes,
) -> None:
    shutil.copy(folder / "session.mcap", tmp_path)
    fields = reader.protobuf_fields
    monkeypatch.setattr(reader, "protobuf_fields", lambda data: fields(data) | {3: kind})
    code = _main(["report", str(tmp_path)])
    assert (code, capsys.readouterr().err) == (
        2,
        f"tams: {tmp_path / 'session.mcap'}: '/shown/eih' holds what is no JPEG picture\n",
    )
    assert not (tmp_path / PAGE_NAME).exists()


def with_arming(*states: ArmingState) -> SessionLog:
    """A log whose ticks are a second each in these states."""
    ticks = [replace(tick(120 * number), arming=state) for number, state in enumerate(states)]
    log = Synthetic(1.0).log()
    return replace(log, ticks=ticks, ended_ns=second(len(states)))


def test_holds_and_faults_are_stretches_until_they_end() -> None:
    ready, hold, fault = ArmingState.READY, ArmingState.HOLDING, ArmingState.FAULT
    log = with_arming(ready, hold, hold, fault, ready, fault)
    found = [(one.name, round(one.start_s), round(one.end_s)) for one in held_stretches(log)]
    assert found == [("hold", 1, 3), ("fault", 3, 4), ("fault", 5, 6)]
    assert held_stretches(with_arming()) == []


def test_all_views_have_one_scale_and_every_phase_its_name_in_the_figure() -> None:
    log = Synthetic(6.0, switch_s=3.0).log()
    figure = timeline_figure(LogTables(log))
    band, *rates = figure.axes[:4]
    assert [text.get_text() for text in band.texts] == ["Reach", "Align"]
    assert len({axis.get_ylim() for axis in rates}) == 1
    most = max(float(np.max(line.get_ydata())) for axis in rates for line in axis.lines)
    assert rates[0].get_ylim()[1] >= most


def test_the_uplink_s_row_has_no_colour_of_a_view() -> None:
    uplink = timeline_figure(LogTables(Synthetic(6.0).log())).axes[4]
    handles, labels = uplink.get_legend_handles_labels()
    drawn = {label: line.get_color() for line, label in zip(handles, labels, strict=True)}
    assert drawn == {
        "sent, all views": palette.UPLINK_SENT,
        "budget": palette.UPLINK_BUDGET,
        "capacity estimate": palette.CAPACITY_ESTIMATE,
        "emulated capacity": palette.EMULATED_CAPACITY,
    }
    assert not set(drawn.values()) & set(palette.VIEW_COLOURS)


def test_no_line_is_drawn_through_seconds_without_a_sample() -> None:
    log = Synthetic(8.0).log()
    away = range(second(2.0), second(6.0))
    log.shown = [one for one in log.shown if one.shown_ns not in away]
    log.quality = [
        FrameQuality("gt", one.index, one.capture_ns, None, None, False, None, None, None, 0.9)
        for one in log.captured
        if one.capture_ns not in away
    ]
    *_, delay, quality = timeline_figure(LogTables(log)).axes[:7]
    names = [view.upper() for view in VIEWS]
    for axis in (delay, quality):
        lines = [line for line in axis.lines if line.get_label() in names]
        assert lines
        for line in lines:
            t_s, values = line.get_data()
            assert not ((t_s[:-1] < 2.6) & (t_s[1:] > 5.4)).any()
            assert np.isnan(values).sum() == 1


def test_a_session_without_video_has_a_figure_too() -> None:
    log = replace(Synthetic(1.0).log(), captured=[], shown=[], packets=[], quality=[], phases=[])
    assert len(timeline_figure(LogTables(log)).axes) == 7


def test_the_slowest_stage_of_the_latency_is_named_and_an_unknown_one_is_a_dash(
    folder: Path, page: str
) -> None:
    assert "Where the time goes" not in page
    log = read_log(folder / "session.mcap")
    log.sent = [
        FrameSent("gt", 0, second(0.1), second(0.1) + 25 * NS_PER_MS, True, 900, 0, 0),
        FrameSent(
            "gs",
            0,
            second(0.1),
            second(0.13),
            True,
            900,
            second(0.1) + 21 * NS_PER_MS,
            0,
            second(0.1) + 2 * NS_PER_MS,
        ),
    ]
    told = unescape(written(log, folder))
    assert "Apart from the network the slowest, at p95, is in GS: camera to encoder." in told
    known = ["GS", "2", "/", "2", "19", "/", "19", "9", "/", "9", *["–", "/", "–"] * 4]
    assert known in [row[: len(known)] for row in rows_of(told)]
