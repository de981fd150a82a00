"""Figures as files: where one can be drawn."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tams_app.errors import ConfigError
from tams_app.outputs import made_folder, new_file

SUFFIXES = (".png", ".jpg")


def check_figure(path: Path) -> None:
    """ConfigError if no figure can be drawn there."""
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"--figure {path}: is drawn to {' or '.join(SUFFIXES)}")
    if not path.parent.is_dir():
        raise ConfigError(f"--figure {path}: there is no folder {path.parent}")
    if path.is_dir():
        raise ConfigError(f"--figure {path}: is a folder, not a file")


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure that needs no display."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: Path, dpi: int = 100) -> None:
    """Write it in the format of the suffix, the same bytes each time; TamsError if it fails."""
    metadata = {"Software": None} if path.suffix.lower() == ".png" else None
    made_folder(path.parent)
    with new_file(path) as file:
        figure.savefig(file, dpi=dpi, metadata=metadata, format=path.suffix[1:].lower())
