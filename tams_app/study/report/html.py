"""A report as one HTML file that needs nothing else: no scripts, no links to elsewhere."""

from __future__ import annotations

import base64
from html import escape

from tams_app.study.report.blocks import (
    Block,
    Document,
    Listing,
    Paragraph,
    Picture,
    Section,
    Table,
)

_STYLE = """
:root { color-scheme: light; }
body { margin: 0 auto; padding: 1.5rem 1rem 4rem; max-width: 60rem; color: #222; background: #fff;
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif; }
h1 { font-size: 1.8rem; line-height: 1.2; margin-bottom: .2rem; }
h2 { font-size: 1.3rem; margin-top: 2.5rem; border-bottom: 2px solid #0072b2; }
.subtitle { color: #555; margin-top: 0; }
.verdict { border-left: 4px solid #d55e00; padding: .2rem .8rem; background: #faf4ef;
  font-weight: 600; }
nav ul { columns: 2; padding-left: 1.2rem; }
a { color: #00558a; }
figure { margin: 1.5rem 0; }
img { width: 100%; height: auto; }
figcaption, caption { color: #444; font-size: .9rem; text-align: left; }
caption { padding: .4rem 0; }
.scroll { overflow-x: auto; margin: 1.2rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums;
  width: 100%; }
th, td { padding: .3rem .6rem; text-align: right; vertical-align: top; }
th[scope=row], th:first-child { text-align: left; white-space: nowrap; }
thead th { border-bottom: 1.5px solid #222; }
tbody tr { border-bottom: 1px solid #ddd; }
tbody th { font-weight: 400; }
@media print { body { max-width: none; font-size: 10pt; } h2 { break-after: avoid; }
  figure, table { break-inside: avoid; } nav { display: none; } }
"""


def render_html(document: Document) -> str:
    """The whole page; figures are embedded."""
    contents = "".join(
        f'<li><a href="#s{number}">{escape(section.title)}</a></li>'
        for number, section in enumerate(document.sections)
    )
    body = "\n".join(_section(number, section) for number, section in enumerate(document.sections))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(document.title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f'<header><h1>{escape(document.title)}</h1><p class="subtitle">'
        f"{escape(document.subtitle)}</p></header>\n"
        f'<nav aria-label="Contents"><ul>{contents}</ul></nav>\n<main>\n{body}\n</main>\n'
        "</body>\n</html>\n"
    )


def _section(number: int, section: Section) -> str:
    blocks = "\n".join(_block(block) for block in section.blocks)
    title = f'<h2 id="s{number}">{escape(section.title)}</h2>'
    return f'<section aria-labelledby="s{number}">\n{title}\n{blocks}\n</section>'


def _block(block: Block) -> str:
    match block:
        case Paragraph(text, verdict):
            mark = ' class="verdict"' if verdict else ""
            return f"<p{mark}>{escape(text)}</p>"
        case Listing(items):
            return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>"
        case Table():
            return _table(block)
        case Picture(_, png, caption, alternative):
            data = base64.b64encode(png).decode("ascii")
            return (
                f'<figure><img alt="{escape(alternative)}" src="data:image/png;base64,{data}">'
                f"<figcaption>{escape(caption)}</figcaption></figure>"
            )


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in table.header)
    rows = "\n".join(
        f'<tr><th scope="row">{escape(first)}</th>'
        f"{''.join(f'<td>{escape(cell)}</td>' for cell in rest)}</tr>"
        for first, *rest in table.rows
    )
    return (
        f'<div class="scroll"><table><caption>{escape(table.caption)}</caption>'
        f"<thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>"
    )
