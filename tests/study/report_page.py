"""Reads a report's page back: what its tables, sentences and images say."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class PageTable:
    """A table's texts."""

    caption: str
    header: list[str]
    rows: list[list[str]]

    def column(self, place: int) -> dict[str, str]:
        """The cells of a column by their row's name."""
        return {row[0]: row[place] for row in self.rows}


@dataclass(frozen=True)
class Page:
    """A report that is well-formed XML, as ours is."""

    text: str

    @cached_property
    def _root(self) -> ElementTree.Element:
        return ElementTree.fromstring(self.text)

    @property
    def sentences(self) -> list[str]:
        """Paragraphs and the items of lists."""
        return [_words(one) for one in self._root.iter() if one.tag in ("p", "li", "h1")]

    @property
    def images(self) -> list[ElementTree.Element]:
        """What holds a plot, with its words for those who do not see it."""
        return [one for one in self._root.iter("div") if one.get("role") == "img"]

    def tables(self, caption: str) -> list[PageTable]:
        """Those with these words in their caption."""
        found = [_table(one) for one in self._root.iter("table")]
        return [one for one in found if caption in one.caption]

    def table(self, caption: str) -> PageTable:
        """The only one."""
        (found,) = self.tables(caption)
        return found


def _table(element: ElementTree.Element) -> PageTable:
    header, *rows = [[_words(cell) for cell in row] for row in element.iter("tr")]
    caption = element.find("caption")
    assert caption is not None
    return PageTable(_words(caption), header, rows)


def _words(element: ElementTree.Element) -> str:
    return " ".join("".join(element.itertext()).split())
