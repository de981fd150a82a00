"""The points that the robot has reached, from a table."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tams_app.errors import ConfigError
from tams_app.records import Vector

COLUMNS = ("x_mm", "y_mm", "z_mm")


def read_points(path: Path) -> list[Vector]:
    """Points [m] of the arm's base frame from columns x_mm, y_mm, z_mm; ConfigError if unfit."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a table of text") from error
    points = []
    for line, row in enumerate(rows, start=2):
        try:
            point = np.array([float(row[column]) for column in COLUMNS]) / 1000
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(
                f"{path}: line {line}: must hold numbers under {', '.join(COLUMNS)}"
            ) from error
        if not np.isfinite(point).all():
            raise ConfigError(f"{path}: line {line}: must hold finite numbers")
        points.append(point)
    return points
