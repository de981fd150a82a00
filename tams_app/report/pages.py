"""How the project's HTML pages are made of their templates."""

from __future__ import annotations

from pathlib import Path

import jinja2


def page_environment(directory: Path) -> jinja2.Environment:
    """For the templates in `directory`: values are escaped, one that is missing is an error."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(directory),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
