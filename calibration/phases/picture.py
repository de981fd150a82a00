"""How much each parameter matters: accuracy around the optimum, as one PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from calibration.phases.fit import Sensitivity
from tams_app.errors import TamsError

_TITLES = {
    "v_eps_mm_s": "still below $v_\\epsilon$ [mm/s]",
    "vz_min_mm_s": "descending above $v_z^{min}$ [mm/s]",
    "align_dwell_s": "dwell $T_{align}$ [s]",
    "pre_release_dwell_s": "dwell $T_{pre}$ [s]",
}
# Okabe and Ito's blue and vermilion: told apart also with deficient colour vision
_CHOSEN, _DEFAULT, _CURVE = "#0072B2", "#D55E00", "#222222"
_SIZE_IN, _DPI = (8.0, 5.0), 110


def save_sensitivity(curves: Sequence[Sensitivity], path: Path) -> None:
    """Draw `curves` to `path`; TamsError if it cannot be written."""
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2, sharey=True)
    for axis, curve in zip(axes.flat, curves, strict=True):
        _draw(axis, curve)
    for row in axes:
        row[0].set_ylabel("frame-wise accuracy")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize=9)
    try:
        figure.savefig(path, dpi=_DPI, format="png")
    except OSError as error:
        raise TamsError(f"{path}: cannot be written: {error.strerror}") from error


def _draw(axis: Axes, curve: Sensitivity) -> None:
    axis.plot(curve.values, curve.accuracy, color=_CURVE, label="the other three as chosen")
    axis.axvline(curve.chosen, color=_CHOSEN, label="chosen")
    axis.axvline(curve.default, color=_DEFAULT, linestyle="--", label="default")
    axis.set_xlabel(_TITLES[curve.parameter], fontsize=9)
    axis.set_xlim(0.0, float(curve.values[-1]))
    axis.tick_params(labelsize=8)
    axis.grid(linewidth=0.5, color="#d9d9d9")
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
