"""Builds the report of a study: report.html, report.pdf, the figures, and the tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tams_app.errors import LogError
from tams_app.study.folder import REPORT_NAME, TABLES_NAME, StudyFolder
from tams_app.study.report.blocks import Document, Picture
from tams_app.study.report.damage_section import damage_section
from tams_app.study.report.design_section import design_section
from tams_app.study.report.differences_section import differences_section
from tams_app.study.report.fidelity_section import fidelity_section
from tams_app.study.report.html import render_html
from tams_app.study.report.operator_section import operator_section
from tams_app.study.report.pdf import write_pdf
from tams_app.study.report.success_section import success_section
from tams_app.study.report.summary_section import summary_section
from tams_app.study.report.time_section import time_section
from tams_app.study.report.tracking_section import tracking_section
from tams_app.study.results import StudyData, read_results
from tams_app.study.tables import write_tables

HTML_NAME = "report.html"
PDF_NAME = "report.pdf"
REMARKS_NAME = "remarks.txt"
REMARKS_BYTES = 100_000


@dataclass(frozen=True, slots=True)
class Written:
    """What a report consists of on disk."""

    html: Path
    pdf: Path
    figures: tuple[Path, ...]
    tables: tuple[Path, ...]


def build_document(
    data: StudyData, remarks: str = "", tolerance_ssim: float | None = None
) -> Document:
    """All sections; `remarks` are the experimenters' own words, paragraphs apart by an empty line.

    `tolerance_ssim`: how far SSIM may differ between processors, where it was measured.
    """
    whose = "simulated operator" if data.plan.simulated else "people on hardware"
    return Document(
        f"{data.plan.name}: {whose}",
        f"{len(data.results)} of {sum(not one.practice for one in data.plan.trials)} planned "
        "trials. Every sentence and figure is made from the study's data by `study report`.",
        (
            summary_section(data, remarks),
            design_section(data, tolerance_ssim),
            tracking_section(data),
            fidelity_section(data),
            damage_section(data),
            time_section(data),
            success_section(data),
            differences_section(data),
            operator_section(data),
        ),
    )


def write_report(
    study: StudyFolder, out: Path | None = None, tolerance_ssim: float | None = None
) -> Written:
    """Read the study, write tables beside it and the report into `out` (default: its report/).

    Remarks are taken from remarks.txt in the study's folder. LogError if there is no result yet
    or the disk refuses.
    """
    data = read_results(study)
    if not data.results:
        raise LogError(f"{study.path}: no trial is done yet: run `study run` first")
    document = build_document(data, _remarks(study), tolerance_ssim)
    tables = write_tables(data, study.path / TABLES_NAME)
    directory = out or study.path / REPORT_NAME
    try:
        directory.mkdir(parents=True, exist_ok=True)
        figures = tuple(
            _write_picture(block, directory)
            for section in document.sections
            for block in section.blocks
            if isinstance(block, Picture)
        )
        (directory / HTML_NAME).write_text(render_html(document), encoding="utf-8")
        write_pdf(document, directory / PDF_NAME)
    except OSError as error:
        raise LogError(f"{directory}: the report cannot be written: {error.strerror}") from error
    return Written(directory / HTML_NAME, directory / PDF_NAME, figures, tuple(tables))


def _write_picture(picture: Picture, directory: Path) -> Path:
    path = directory / f"{picture.name}.png"
    path.write_bytes(picture.png)
    return path


def _remarks(study: StudyFolder) -> str:
    path = study.path / REMARKS_NAME
    if not path.is_file():
        return ""
    return path.read_text(encoding="utf-8", errors="replace")[:REMARKS_BYTES]
