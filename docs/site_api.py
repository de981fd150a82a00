"""A hook of the site: in API.md each name becomes its reference, which mkdocstrings makes."""

import re
from typing import Any

_ENTRY = re.compile(r"^- \[`([\w.]+)`\]\(\S+\.py\).*$", re.MULTILINE)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Replace the list's entries by mkdocstrings' directives.

    Args:
        markdown: text of the page.
        page: of mkdocs; all but docs/API.md stay as they are.

    Returns:
        The text of the page on the site.
    """
    if page.file.src_uri != "docs/API.md":
        return markdown
    return _ENTRY.sub(r"::: \1\n", markdown)
