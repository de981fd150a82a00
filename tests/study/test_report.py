"""The report says what the numbers say: planted effects are found, absent ones are not."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from tams_app.errors import LogError
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import void
from tams_app.study.report import paired
from tams_app.study.report.blocks import Document, Listing, Paragraph, Picture, Section, Table
from tams_app.study.report.build import build_document, write_report
from tams_app.study.report.comparing import Finding, Measure, compare, judge
from tams_app.study.report.damage_section import damage_section
from tams_app.study.report.design_section import design_section
from tams_app.study.report.drawing import picture
from tams_app.study.report.html import render_html
from tams_app.study.report.model_table import model_blocks
from tams_app.study.report.operator_section import operator_section
from tams_app.study.report.pdf import write_pdf
from tams_app.study.report.summary_section import received_ssim, success_share
from tams_app.study.results import StudyData, TrialResult, read_results
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study

pytestmark = pytest.mark.untimed

for extra in ("pandas", "pyarrow", "statsmodels"):
    pytest.importorskip(extra)

WINNING = PlantedRunner({"tams": -12.0}, {"tams": 0.02}, noise_s=2.0, lapses=0.0)
EVEN = PlantedRunner(noise_s=2.0, lapses=0.0)
LOSING = PlantedRunner({"tams": 12.0}, {"tams": -0.02}, noise_s=2.0, lapses=0.0)
TWO_BY_TWO = {"study__strategies": ["equal", "tams"], "study__networks": ["s1", "s3"]}


def document(path: Path, runner: PlantedRunner, people: int = 12, **more: Any) -> Document:
    study = make_study(path, people, **{**TWO_BY_TWO, **more})
    fill_study(study, runner)
    return build_document(read_results(study))


def texts(found: Document | Section) -> list[str]:
    """Every sentence of it."""
    sections = found.sections if isinstance(found, Document) else (found,)
    blocks = [block for section in sections for block in section.blocks]
    return [block.text for block in blocks if isinstance(block, Paragraph)] + [
        item for block in blocks if isinstance(block, Listing) for item in block.items
    ]


def tables(found: Document, caption: str) -> list[Table]:
    blocks = [block for section in found.sections for block in section.blocks]
    return [one for one in blocks if isinstance(one, Table) and caption in one.caption]


def claims(found: Document) -> list[str]:
    return [text for text in texts(found.sections[0]) if text.startswith("Claim:")]


def censored_s(result: TrialResult) -> float | None:
    return result.censored_time_s(120.0)


@pytest.fixture(scope="module")
def even_data(tmp_path_factory: pytest.TempPathFactory) -> StudyData:
    """A study of strategies that do not differ."""
    study = make_study(tmp_path_factory.mktemp("even"), 12, **TWO_BY_TWO)
    fill_study(study, EVEN)
    return read_results(study)


@pytest.fixture(scope="module")
def even(even_data: StudyData) -> Document:
    """Its report."""
    return build_document(even_data)


def test_a_planted_advantage_holds(tmp_path: Path) -> None:
    ssim, time, _ = claims(document(tmp_path, WINNING))
    assert ssim.endswith("2 comparisons: holds: 2.")
    assert time.endswith("2 comparisons: holds: 2.")


def test_where_nothing_was_planted_hardly_any_interval_excludes_zero(tmp_path: Path) -> None:
    """At 95 % one interval in twenty may; ten would be far too many."""
    shown = 0
    for seed in range(5):
        study = make_study(tmp_path / str(seed), 12, **TWO_BY_TWO, seed=seed)
        fill_study(study, EVEN)
        data = read_results(study)
        for network in data.plan.networks:
            for measure in (received_ssim, success_share, censored_s):
                found = compare(data, "equal", network, measure)
                shown += judge(found, more_is_better=True) is not Finding.NOT_SHOWN
    assert shown <= 4  # of 30


def test_a_planted_disadvantage_is_said_as_plainly(tmp_path: Path) -> None:
    found = document(tmp_path, LOSING)
    ssim, time, _ = claims(found)
    assert ssim.endswith("2 comparisons: the opposite holds: 2.")
    assert time.endswith("the opposite holds: 2.")
    assert any(text.startswith("S1, TAMS against Equal, by phase (paired): lower in Reach")
               for text in texts(found))  # fmt: skip


def test_a_handful_of_participants_decides_nothing(tmp_path: Path) -> None:
    found = document(tmp_path, WINNING, people=3)
    assert all(claim.endswith("not known: 2.") for claim in claims(found))
    assert any("3 participants: too few for an interval" in text for text in texts(found))


def test_simulated_operator_and_people_are_never_mixed_up(even: Document) -> None:
    found = even
    assert "simulated operator" in found.title
    (overall,) = tables(found, "SSIM of the primary view, mean of the phase means")
    assert overall.header[1] == "Received, simulated operator"
    assert overall.header[4] == "Received, paper, 16 people on hardware"
    theirs = {row[0]: row[4] for row in overall.rows}
    assert theirs == {
        "S1, Equal": "0.944",
        "S1, TAMS": "0.968",
        "S3, Equal": "0.764",
        "S3, TAMS": "0.794",
    }
    (times,) = tables(found, "Completion times with")
    assert [row[-1] for row in times.rows] == ["24.7", "23.5", "68.9", "43.9"]
    (success,) = tables(found, "Success and completion")
    assert [row[-1] for row in success.rows] == ["90–92 %", "90–92 %", "48 %", "71 %"]


def test_what_is_missing_is_listed(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, **TWO_BY_TWO)
    fill_study(study, PlantedRunner(missing_phase="PRE_RELEASE"), leave=("P02-03",))
    study.save(void(study.load(), "P01-02", "the light went out"))
    sentences = texts(design_section(read_results(study), None))
    assert "Missing: 2 planned trials: P01-02, P02-03." in sentences
    assert "P01-02: void, the light went out" in sentences
    assert any(text.startswith("Not counterbalanced") for text in sentences)
    assert any("Pre-release in 6 of 6 trials" in text for text in sentences)


def test_how_long_the_phases_lasted_is_told(even: Document) -> None:
    (told,) = [text for text in texts(even) if text.startswith("Phases lasted")]
    assert told == (
        "Phases lasted, medians over all trials: Reach 5.00 s, Align 5.00 s, Grasp 5.00 s, "
        "Transport 5.00 s, Pre-release 5.00 s and Release 15.00 s."
    )


def test_the_machine_and_its_tolerance_are_stated(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, **TWO_BY_TWO)
    fill_study(study, EVEN)
    data = read_results(study)
    assert any("this study did not measure" in text for text in texts(design_section(data, None)))
    stated = texts(design_section(data, 0.002))
    assert any("within 0.002 in SSIM, as measured" in text for text in stated)


def test_a_model_that_cannot_be_fitted_is_a_sentence(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **TWO_BY_TWO)
    fill_study(study, EVEN)
    first, second = model_blocks(read_results(study))
    assert isinstance(first, Paragraph)
    assert isinstance(second, Paragraph)
    assert "at least two participants" in first.text


def planted(cell: str) -> float:
    """The value before its interval."""
    return float(cell.split()[0].replace("−", "-"))


def test_the_difference_of_ssim_is_also_taken_in_other_ways(even: Document) -> None:
    (table,) = tables(even, "taken in other ways")
    by_phases, common, by_time, all_views = map(planted, table.rows[0][1:])
    assert by_time == pytest.approx(by_phases + 0.01, abs=1e-4)  # as planted
    assert common == pytest.approx(by_phases, abs=1e-4)  # no phase is missing
    assert all_views == pytest.approx(by_phases, abs=1e-4)  # each view is planted like the primary


def test_a_phase_that_one_trial_of_a_pair_lacks_is_left_out_of_the_other(tmp_path: Path) -> None:
    study = make_study(tmp_path, 6, **TWO_BY_TWO)
    fill_study(study, EVEN)
    data = read_results(study)
    (whole,) = tables(build_document(data), "taken in other ways")
    for one in data.of("tams", "s1"):  # a phase much better than the others, of TAMS alone
        one.summary["primary_view"]["by_phase"]["RELEASE"]["received_ssim"] = 1.0
    for one in data.of("equal", "s1"):
        del one.summary["primary_view"]["by_phase"]["RELEASE"]
    (cut,) = tables(build_document(data), "taken in other ways")
    assert planted(cut.rows[0][2]) == pytest.approx(planted(whole.rows[0][2]), abs=0.004)


def test_what_coding_won_and_loss_took_again_are_told_apart(tmp_path: Path) -> None:
    """Planted on s3: equal received SSIM, of which loss takes .03 more from TAMS."""
    runner = PlantedRunner(noise_s=2.0, lapses=0.0, lost_ssim={"tams": 0.05, "equal": 0.02})
    study = make_study(tmp_path, 12, **TWO_BY_TWO)
    fill_study(study, runner)
    data = read_results(study)

    def difference(measure: Measure, network: str) -> float:
        found = compare(data, "equal", network, measure).estimate
        assert found is not None
        return found.value

    received = difference(received_ssim, "s3")
    assert difference(lambda one: one.lost_ssim, "s3") == pytest.approx(-0.03)
    assert difference(lambda one: one.coding_ssim, "s3") == pytest.approx(received + 0.03, abs=1e-4)
    assert difference(lambda one: one.lost_ssim, "s1") == pytest.approx(0)
    section = damage_section(data)
    told = [text for text in texts(section) if "by loss make" in text]
    assert [text.split(",")[0] for text in told] == ["S3"]  # nothing is damaged on S1
    assert "−0.0300 by loss" in told[0]
    parts = next(one for one in section.blocks if isinstance(one, Table))
    assert parts.rows[0][4].startswith("4.50 ")
    shares = [one for one in section.blocks if isinstance(one, Table) and "Share" in one.caption]
    assert ["on S3," in one.caption for one in shares] == [True]
    assert shares[0].rows[0][1].startswith("0.200 ")


def test_a_study_that_knows_nothing_of_damage_says_so(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **TWO_BY_TWO)
    fill_study(study, PlantedRunner(damage_told=False))
    told = texts(damage_section(read_results(study)))
    assert told == ["No trial tells which frames were damaged by loss."]


def test_a_phase_without_an_undamaged_frame_has_no_part_in_what_loss_took(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **TWO_BY_TWO)
    fill_study(study, PlantedRunner(lost_ssim={"tams": 0.05}))
    data = read_results(study)
    (one,) = data.of("tams", "s3")
    by_phase = one.summary["primary_view"]["by_phase"]
    by_phase["GRASP"] |= {"undamaged_received_ssim": None, "received_ssim": 0.1}
    assert one.lost_ssim == pytest.approx(-0.05)
    assert one.coding_ssim == pytest.approx((one.parted_ssim or 0.0) + 0.05)
    assert any("undamaged frame (1 in all trials)" in text for text in texts(damage_section(data)))
    for scores in by_phase.values():
        scores["undamaged_received_ssim"] = None
    assert one.lost_ssim is None
    assert one.coding_ssim is None


def test_parts_of_a_sum_are_drawn_on_one_scale_and_an_empty_panel_does_not_set_it(
    even_data: StudyData, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []

    def keep(figure: Figure, name: str, caption: str, alternative: str) -> Picture:
        drawn.append(figure)
        return picture(figure, name, caption, alternative)

    monkeypatch.setattr(paired, "picture", keep)
    quantities = [
        paired.Quantity("received", "", received_ssim, 4),
        paired.Quantity("a tenth of it", "", lambda one: (received_ssim(one) or 0.0) / 10, 4),
        paired.Quantity("nobody knows", "", lambda one: None, 4),
    ]
    paired.paired_figure(even_data, "parts", "", quantities, one_scale=True)
    first, second, third = (axis.get_xlim() for axis in drawn[0].axes)
    assert first == second == third
    assert first[1] - first[0] < 0.1  # an empty axis would be 1 wide


def test_how_sure_the_operator_was_stands_beside_what_he_relied_on(even: Document) -> None:
    (table,) = tables(even, "How sure the simulated operator was")
    assert table.rows[0] == ("Reach", "1.25", "1.25", "1.25", "1.25")


def test_agreement_with_w_is_measured_and_not_assumed(even: Document, tmp_path: Path) -> None:
    (agreement,) = tables(even, "Agreement:")
    # the planted operator is half of the time on EIH, W's choice in four of six phases
    assert agreement.rows[0][1].startswith("0.42 ")
    (by_glances,) = tables(even, "fraction of glances")
    assert by_glances.rows[0][1].startswith("0.60 ")
    study = make_study(tmp_path, 1, **TWO_BY_TWO)
    fill_study(study, PlantedRunner(relied=False))
    sentences = texts(operator_section(read_results(study)))
    assert sentences == ["No trial tells which view the operator relied on."]


def test_the_report_is_one_page_without_links_and_its_figures_beside_it(tmp_path: Path) -> None:
    study = make_study(tmp_path / "study", 6, **TWO_BY_TWO)
    fill_study(study, WINNING)
    (study.path / "remarks.txt").write_text("First <b>remark</b>.\n\nSecond.")
    written = write_report(study, tmp_path / "out")
    page = written.html.read_text(encoding="utf-8")
    assert not re.search(r"https?://|<script|<link|@import|url\(", page)
    assert "First &lt;b&gt;remark&lt;/b&gt;." in page
    assert page.count("<img alt=") == len(written.figures) == 7
    assert all(len(alt) > 20 for alt in re.findall(r'<img alt="([^"]*)"', page))
    assert written.pdf.read_bytes().startswith(b"%PDF")
    names = {path.stem for path in written.figures}
    assert names == {
        "ssim",
        "ssim_phases",
        "completion_time",
        "success",
        "damage",
        "differences",
        "relied_on",
    }
    for path in written.figures:
        picture = cv2.imread(str(path))
        assert picture is not None
        assert picture.std() > 5
    total = sum(path.stat().st_size for path in (tmp_path / "out").iterdir())
    assert total < 5_000_000
    assert all(path.is_file() for path in written.tables)


def test_a_study_without_results_has_no_report(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **TWO_BY_TWO)
    with pytest.raises(LogError, match="no trial is done yet"):
        write_report(study)
    assert not (StudyFolder(tmp_path).path / "report").exists()


def test_html_and_pdf_take_any_text(tmp_path: Path) -> None:
    picture = np.zeros((8, 8, 3), np.uint8)
    png = cv2.imencode(".png", picture)[1].tobytes()
    hostile = 'a "quoted" <script>$x_1^2$</script> & more'
    section = Section(
        hostile,
        (
            Paragraph(hostile, verdict=True),
            Listing((hostile,)),
            Table(hostile, (hostile, "b"), ((hostile, hostile),) * 80),
            Picture("name", png, hostile, hostile),
        ),
    )
    found = Document(hostile, hostile, (section,))
    page = render_html(found)
    assert "<script>" not in page
    assert html.escape(hostile) in page
    write_pdf(found, tmp_path / "report.pdf")
    content = (tmp_path / "report.pdf").read_bytes()
    assert len(re.findall(rb"/Type /Page\b", content)) >= 2
    write_pdf(found, tmp_path / "again.pdf")
    assert (tmp_path / "again.pdf").read_bytes() == content  # reproducible
