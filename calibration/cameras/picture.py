"""What was found as a picture: the views with their figures, and the latencies' histogram."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from calibration.cameras.findings import Findings
from calibration.cameras.focus import blur_words
from tams_app.errors import ConfigError

# Okabe and Ito's palette: told apart also with deficient colour vision
_COLOURS = ("#E69F00", "#0072B2", "#009E73", "#CC79A7")
_DPI = 100
_SUFFIXES = (".png", ".jpg")
_BINS_MS = 2.0
_MOST_BINS = 80


def check_drawable(path: Path) -> None:
    """ConfigError if no picture can be drawn there."""
    if path.suffix.lower() not in _SUFFIXES:
        raise ConfigError(f"{path}: a picture is drawn to {' or '.join(_SUFFIXES)}")
    if not path.parent.is_dir():
        raise ConfigError(f"{path}: there is no folder {path.parent}")


def draw_findings(found: Sequence[Findings], path: Path) -> None:
    """Write a PNG or a JPEG; ConfigError if the path says neither or cannot be written."""
    check_drawable(path)
    timed = [each for each in found if each.to_capture or each.to_shown]
    figure = Figure(figsize=(9.6, 6.2 if timed else 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    heights = (3, 2) if timed else (1,)
    grid = figure.add_gridspec(len(heights), len(found), height_ratios=heights)
    for column, each in enumerate(found):
        _view(figure.add_subplot(grid[0, column]), each)
    if timed:
        _histogram(figure.add_subplot(grid[1, :]), timed)
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def _view(axes: Axes, found: Findings) -> None:
    axes.set_title(f"{found.view.upper()}: {found.camera}", fontsize=9)
    if found.image is not None:
        axes.imshow(cv2.cvtColor(found.image, cv2.COLOR_BGR2RGB))
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_xlabel("\n".join(figures(found)), fontsize=7.5, loc="left")


def figures(found: Findings) -> list[str]:
    """What is known of one view, a line each."""
    lines = []
    if found.sharpness is not None:
        lines.append(blur_words(found.sharpness))
    if found.exposure is not None:
        seen = found.exposure
        flicker = "" if seen.flicker is None else f", flicker {seen.flicker:.1%}"
        lines.append(
            f"mean grey {seen.mean_grey:.0f}, white {seen.too_bright:.1%}, "
            f"black {seen.too_dark:.1%}{flicker}"
        )
    if found.rate is not None:
        rate = found.rate
        lines.append(
            f"{rate.rate_hz:.2f} Hz, jitter {rate.jitter_ms:.1f} ms, "
            f"missed {rate.missed} of {rate.frames + rate.missed}"
        )
    if found.intrinsics is not None:
        lens = found.intrinsics
        lines.append(
            f"f = {lens.values['fx']:.0f} ± {lens.errors['fx']:.1f} px, "
            f"reprojection {lens.rms_px:.2f} px"
        )
    return lines


def _histogram(axes: Axes, found: Sequence[Findings]) -> None:
    latest = max(
        measured.p95_ms
        for each in found
        for measured in (each.to_capture, each.to_shown)
        if measured is not None
    )
    width = max(_BINS_MS, latest / _MOST_BINS)
    bins = [width * step for step in range(round(1.1 * latest / width) + 2)]
    for colour, each in zip(_COLOURS, found, strict=False):
        for measured, style, name in (
            (each.to_capture, "-", "light to capture"),
            (each.to_shown, "--", "capture to shown"),
        ):
            if measured is None:
                continue
            axes.hist(
                measured.samples_ms,
                bins=bins,
                histtype="step",
                color=colour,
                linestyle=style,
                label=f"{each.view.upper()} {name}: {measured.median_ms:.1f} ms",
            )
    axes.set_xlabel("ms", fontsize=8)
    axes.set_ylabel("pictures", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7.5, frameon=False)
