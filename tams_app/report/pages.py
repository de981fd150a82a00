"""The page kit: what the HTML pages of sessions and studies share, and how they are made."""

from __future__ import annotations

from pathlib import Path

import jinja2

from tams_app.report.plots import THEME

_SHARED = Path(__file__).parent  # page.html.j2: head and style; parts.html.j2: table, figure, tiles


def page_environment(directory: Path = _SHARED) -> jinja2.Environment:
    """For the templates in `directory`: values are escaped, one that is missing is an error."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([directory, _SHARED]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["theme"] = THEME
    return environment
