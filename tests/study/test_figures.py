"""bitrates.png: what is drawn is what was sent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.text import Annotation

from tams_app.recording import SessionLog
from tams_app.records import Phase, PhaseChange
from tams_app.report.figures import bitrates_figure, measured_rate
from tams_app.report.plots import DPI, PAPER_IN, save_figure
from tams_app.summary.tables import LogTables, Span
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, Synthetic, header

pytestmark = pytest.mark.untimed


def test_the_measured_curve_is_the_rate_on_the_wire_without_a_saw() -> None:
    tables = LogTables(Synthetic(6.0, switch_s=3.0).log())
    span = tables.span
    curve = measured_rate(tables.packets, 0, span, NS_PER_S // 30, START_NS)
    steady = (curve.t_s > 0.4) & (curve.t_s < 3.0)
    np.testing.assert_allclose(curve.kbps[steady], 1000, rtol=0.02)
    np.testing.assert_allclose(curve.kbps[curve.t_s > 3.4], 3000, rtol=0.02)
    assert curve.t_s[0] == pytest.approx(0.25 + 0.025, abs=1e-6)  # never before a whole window


def test_where_frames_are_rare_the_windows_are_longer_and_there_is_no_saw() -> None:
    tables = LogTables(Synthetic(6.0).log())
    span, packets = tables.span, tables.packets
    stretched = replace(packets, entered_ns=START_NS + 6 * (packets.entered_ns - START_NS))
    longer = Span(span.start_ns, START_NS + 36 * NS_PER_S)
    curve = measured_rate(stretched, 0, longer, NS_PER_S // 5, START_NS)
    np.testing.assert_allclose(curve.kbps[8:], 1000 / 6, rtol=0.02)
    assert curve.t_s[0] == pytest.approx(1.5 + 0.15, abs=1e-6)


def test_each_view_has_its_target_and_each_phase_its_dashed_line_and_name() -> None:
    log = Synthetic(6.0, switch_s=3.0).log()
    figure = bitrates_figure(LogTables(log))
    assert len(figure.axes) == 6  # one for the rate and one for the frames of each view
    target = figure.axes[0].lines[0]
    times, kbps = np.asarray(target.get_xdata()), np.asarray(target.get_ydata())
    assert kbps[times < 2.99].tolist() == [1.0] * np.sum(times < 2.99)
    assert kbps[-1] == 3.0
    for axis in figure.axes[:3]:
        dashed = [line for line in axis.lines if line.get_linestyle() == "--"]
        assert [float(np.asarray(line.get_xdata())[0]) for line in dashed] == [0.0, 3.0]
    names = [text.get_text() for text in figure.axes[0].texts if isinstance(text, Annotation)]
    assert names == ["REACH", "ALIGN"]


def test_each_view_has_the_frames_it_was_given_on_a_scale_up_to_what_was_asked() -> None:
    log = Synthetic(6.0).log()
    log.captured = [
        one
        for one in log.captured
        if one.view == "gt" or one.index % 2 == 0 or one.capture_ns < START_NS + 3 * NS_PER_S
    ]
    figure = bitrates_figure(LogTables(log))
    for axis, last in zip(figure.axes[3:], (15, 30, 15), strict=True):
        (line,) = axis.lines
        rates = np.asarray(line.get_ydata())
        assert rates[0] == pytest.approx(30, abs=1)
        assert rates[-1] == pytest.approx(last, abs=1)
        assert max(axis.get_yticks()) == 30


def test_a_phase_too_short_for_its_name_keeps_its_line() -> None:
    log = Synthetic(6.0, switch_s=3.0).log()
    log.phases.append(PhaseChange(START_NS + round(3.05 * NS_PER_S), Phase.GRASP, "closed"))
    figure = bitrates_figure(LogTables(log))
    names = [text.get_text() for text in figure.axes[0].texts]
    assert names == ["REACH", "GRASP"]
    assert sum(line.get_linestyle() == "--" for line in figure.axes[2].lines) == 3


def test_the_file_is_an_image_for_print(tmp_path: Path) -> None:
    save_figure(bitrates_figure(LogTables(Synthetic(2.0).log())), tmp_path / "bitrates.png")
    image = cv2.imread(str(tmp_path / "bitrates.png"))
    assert image is not None
    assert image.shape[1] == round(PAPER_IN * DPI)
    assert image.std() > 5


@pytest.mark.parametrize("seconds", [0.0, 0.1])
def test_a_session_without_video_leaves_a_figure_too(tmp_path: Path, seconds: float) -> None:
    log = Synthetic(seconds).log() if seconds else SessionLog(header(), START_NS)
    save_figure(bitrates_figure(LogTables(log)), tmp_path / "bitrates.png")
    assert (tmp_path / "bitrates.png").stat().st_size > 0
