"""The view weight matrix W (paper, section III-C, Table I)."""

from __future__ import annotations

from collections.abc import Mapping

from tams_app.records import Phase


class WeightMatrix:
    """W[p, v], phases by views; each row sums to 1 (equation 2), which the configuration checks."""

    def __init__(self, rows: Mapping[Phase, Mapping[str, float]]) -> None:
        self._rows = {phase: dict(row) for phase, row in rows.items()}
        self._primary = {phase: max(row, key=row.__getitem__) for phase, row in rows.items()}

    def row(self, phase: Phase) -> dict[str, float]:
        """The share of each view in `phase`."""
        return dict(self._rows[phase])

    def primary_view(self, phase: Phase) -> str:
        """The view with the largest share in `phase`; of equals, the first named."""
        return self._primary[phase]
