"""What several tests of a study's report need."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report without its figures, which take most of the time."""
    for extra in ("jinja2", "pandas", "pyarrow", "statsmodels"):
        pytest.importorskip(extra)
    from tams_app.study.report import build

    monkeypatch.setattr(build, "drawing", MagicMock())
    monkeypatch.setattr(build, "to_png", lambda figure: b"drawn")
    monkeypatch.setattr(build, "to_svg", lambda figure: "drawn")
