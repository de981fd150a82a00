"""The view weight matrix W (paper, section III-C, Table I)."""

from __future__ import annotations

from collections.abc import Mapping

from tams_app.records import Phase


class WeightMatrix:
    """W[p, v], phases by views; each row sums to 1 (equation 2), which the configuration checks."""

    def __init__(self, rows: Mapping[Phase, Mapping[str, float]]) -> None:
        self._rows = {phase: dict(row) for phase, row in rows.items()}
        self._primary = {phase: max(row, key=row.__getitem__) for phase, row in rows.items()}
        self._row_of: dict[str, Phase] = {}
        for view in dict.fromkeys(view for row in rows.values() for view in row):
            shares = {one: (self._primary[one] == view, rows[one].get(view, 0.0)) for one in rows}
            self._row_of[view] = max(shares, key=shares.__getitem__)

    def row(self, phase: Phase) -> dict[str, float]:
        return dict(self._rows[phase])

    def primary_view(self, phase: Phase, pinned: str = "") -> str:
        """The view that the operator has `pinned`; else, or if there is none of that name, the one
        with the largest share in `phase`, of equals the first named.
        """
        return pinned if pinned in self._row_of else self._primary[phase]

    def row_phase(self, phase: Phase, pinned: str = "") -> Phase:
        """The phase whose row the shares follow while `pinned` is the primary view.

        That is `phase` itself where the view is primary in it; else, of the phases in which it is,
        the one with its largest share; of a view that is primary in none, of all phases.
        """
        primary = self.primary_view(phase, pinned)
        return phase if primary == self._primary[phase] else self._row_of[primary]
