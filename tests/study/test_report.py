"""The report says what the numbers say: planted effects are found, absent ones are not."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import cv2
import pytest

from tams_app.errors import ConfigError
from tams_app.report.pages import Estimate
from tams_app.study.plan import void
from tams_app.study.report import drawing
from tams_app.study.report.build import build_report
from tams_app.study.report.measures import (
    Measures,
    Quantity,
    claims,
    compared,
    difference_sentence,
)
from tams_app.study.results import StudyData, read_results, read_tables, write_tables
from tams_app.study.statistics import PairedDifference
from tests.study.report_page import Page
from tests.study.synthetic_study import (
    PlantedRunner,
    fill_study,
    make_study,
    planted_data,
    small_config,
)

pytestmark = pytest.mark.untimed

for extra in ("jinja2", "pandas", "pyarrow", "statsmodels"):
    pytest.importorskip(extra)

WINNING = PlantedRunner({"tams": -12.0}, {"tams": 0.02}, noise_s=2.0, lapses=0.0)
EVEN = PlantedRunner(noise_s=2.0, lapses=0.0)
LOSING = PlantedRunner({"tams": 12.0}, {"tams": -0.02}, noise_s=2.0, lapses=0.0)
TWO_BY_TWO = {"study__strategies": ["equal", "tams"], "study__networks": ["s1", "s3"]}
HOSTILE = 'a "quoted" <script>$x_1^2$</script> & more'


def measured(runner: PlantedRunner, people: int = 12, **more: Any) -> Measures:
    return Measures(planted_data(runner, people, **{**TWO_BY_TWO, **more}))


def page_of(data: StudyData, **more: Any) -> Page:
    return Page(build_report(data, **more).html)


def estimate(found: PairedDifference) -> float:
    return found.estimate.value


@pytest.fixture(scope="module")
def even() -> StudyData:
    """A study of strategies that do not differ."""
    return planted_data(EVEN, 12, **TWO_BY_TWO)


@pytest.fixture(scope="module")
def folder(even: StudyData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where its report is written, with remarks."""
    out = tmp_path_factory.mktemp("report")
    build_report(even, f"First {HOSTILE}.\n\nSecond.").write(out)
    return out


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("runner", "finding", "ssim"), [(WINNING, "holds", 0.02), (LOSING, "the opposite holds", -0.02)]
)
def test_a_planted_advantage_holds_and_a_disadvantage_is_said_as_plainly(
    runner: PlantedRunner, finding: str, ssim: float
) -> None:
    measures = measured(runner)
    of_ssim, of_time, _ = claims(measures)
    assert of_ssim.tally == of_time.tally == f"2 comparisons: {finding}: 2"
    difference = measures.difference("equal", "s1", "received_ssim", "REACH")
    assert estimate(difference) == pytest.approx(ssim, abs=0.005)


def test_favourable_and_unfavourable_differences_get_the_same_test_and_words() -> None:
    quantity = Quantity("SSIM", "any", 3)
    for p, favourable, unfavourable in (
        (0.04, "holds", "the opposite holds"),
        (0.052, "no difference shown", "no difference shown"),
        (0.10, "no difference shown", "no difference shown"),
    ):
        for value, verdict in ((0.1, favourable), (-0.1, unfavourable)):
            found = PairedDifference(Estimate(value, value - 0.1, value + 0.1, 18), p, 18, 0)
            words = difference_sentence(found, quantity)
            assert words.startswith(f"{verdict} (paired t test, p = .{round(1000 * p):03})")


def test_a_handful_of_participants_decides_nothing() -> None:
    found = claims(measured(WINNING, people=3))
    assert all(claim.tally.endswith("not known: 2") for claim in found)
    assert "not known (3 participants: too few to test)" in found[0].sentences[0]


def test_simulated_operator_and_people_are_never_mixed_up(page: Page) -> None:
    assert page.sentences[0] == "TAMS study: simulated operator"
    overall = page.table("SSIM of the primary view, mean of the phase means")
    assert overall.header[1] == "Received, simulated operator"
    assert overall.header[4:6] == ["Received at the task", "Live at the task"]
    assert overall.header[6] == "Received, paper, 16 people on hardware"
    assert overall.column(6) == {
        "S1, Equal": "0.944",
        "S1, TAMS": "0.968",
        "S3, Equal": "0.764",
        "S3, TAMS": "0.794",
    }
    assert [*page.table("Completion times with").column(5).values()] == [
        "24.7",
        "23.5",
        "68.9",
        "43.9",
    ]
    success = page.table("Success and completion").column(5)
    assert [*success.values()] == ["90–92 %", "90–92 %", "48 %", "71 %"]


def test_what_the_figures_are_worth_is_said(page: Page) -> None:
    told = " ".join(page.sentences)
    assert "that S1 agrees with the paper is no finding" in told
    assert "the paper prints none" in told  # of the thresholds
    assert "the paper does not say which it took" in page.table("Welch's t-test").caption
    assert "fitted to the paper's times under S1" in page.table("Completion times with").caption


def test_a_study_s_report_has_only_what_that_study_gave(page: Page, even: StudyData) -> None:
    """No machine, trial or measurement of another study than this one."""
    trials = set(even.trials["trial"])
    for text in page.sentences:
        assert not re.search(r"EPYC|Xeon|AVX|published study|our calibrator|docs/", text)
        assert set(re.findall(r"P\d\d-\d\d", text)) <= trials


def test_what_is_missing_is_listed(tmp_path: Path, undrawn: None) -> None:
    study = make_study(tmp_path, 2, **TWO_BY_TWO)
    fill_study(study, PlantedRunner(missing_phase="PRE_RELEASE"), leave=("P02-03",))
    study.save(void(study.load(), "P01-02", "the light went out"))
    sentences = page_of(read_results(study), tolerance_ssim=0.002).sentences
    assert "Missing: 2 planned trials: P01-02, P02-03." in sentences
    assert "P01-02: void, the light went out" in sentences
    assert any(text.startswith("Not counterbalanced") for text in sentences)
    assert any("Pre-release in 6 of 6 trials" in text for text in sentences)
    assert any("differ, within 0.002 in SSIM." in text for text in sentences)


def test_how_long_the_phases_lasted_is_told(page: Page) -> None:
    (told,) = [text for text in page.sentences if text.startswith("Phases lasted")]
    assert told == (
        "Phases lasted, medians over all trials: Reach 5.00 s, Align 5.00 s, Grasp 5.00 s, "
        "Transport 5.00 s, Pre-release 5.00 s and Release 15.00 s."
    )


def test_a_study_that_knows_little_says_so(undrawn: None) -> None:
    """One participant, no loss, no reliance, no completed trial; thresholds that were set."""
    runner = PlantedRunner({"tams": 500.0, "equal": 500.0}, damage_told=False, relied=False)
    data = planted_data(runner, 1, policy__phases__v_eps_mm_s=7.0, **TWO_BY_TWO)
    sentences = page_of(data).sentences
    assert "Phases are inferred with thresholds other than TAMS's defaults." in sentences
    assert not any("the paper prints none" in text for text in sentences)
    assert "No trial tells which frames loss left incomplete." in sentences
    assert "No trial tells which view the operator relied on." in sentences
    assert "No trial was completed." in sentences


def test_a_planted_effect_is_in_the_model_and_one_that_cannot_be_fitted_is_a_sentence() -> None:
    model = measured(WINNING).model("censored_time_s")
    terms = {one.name: one for one in model.terms}
    assert list(terms) == ["Intercept", "tams", "s3", "tams × s3"]
    assert terms["tams"].low < -12 < terms["tams"].high < 0
    assert terms["tams × s3"].p > 0.05
    found = measured(EVEN, people=1).model("censored_time_s")
    assert "at least two participants" in getattr(found, "reason", "")


def value(cell: str) -> float:
    """The value before its interval."""
    return float(cell.split()[0].replace("−", "-"))


def test_the_difference_of_ssim_is_also_taken_in_other_ways(page: Page) -> None:
    by_phases, common, by_time, all_views = map(value, page.table("in other ways").rows[0][1:])
    assert by_time == pytest.approx(by_phases + 0.01, abs=1e-4)  # as planted
    assert common == pytest.approx(by_phases, abs=1e-4)  # no phase is missing
    assert all_views == pytest.approx(by_phases, abs=1e-4)  # each view is planted like the primary


def test_a_phase_that_one_trial_of_a_pair_lacks_is_left_out_of_the_other() -> None:
    measures = measured(EVEN, people=6)
    whole = estimate(measures.common_phases_difference("equal", "s1"))
    phases = measures.data.phases
    release = phases["phase"] == "RELEASE"
    # a phase much better than the others, of TAMS alone
    phases.loc[release & (phases["strategy"] == "tams"), "received_ssim"] = 1.0
    phases.loc[release & (phases["strategy"] == "equal"), "received_ssim"] = None
    cut = estimate(measures.common_phases_difference("equal", "s1"))
    assert cut == pytest.approx(whole, abs=0.004)


def test_what_coding_won_and_loss_took_again_are_told_apart(undrawn: None) -> None:
    """Planted on s3: equal received SSIM, of which loss takes .03 more from TAMS."""
    lost = {"tams": 0.05, "equal": 0.02}
    data = planted_data(PlantedRunner(noise_s=2.0, lapses=0.0, lost_ssim=lost), 12, **TWO_BY_TWO)
    measures = Measures(data)

    def difference(column: str, network: str) -> float:
        return estimate(measures.difference("equal", network, column))

    received = difference("primary_received_ssim", "s3")
    assert difference("lost_ssim", "s3") == pytest.approx(-0.03)
    assert difference("undamaged_ssim", "s3") == pytest.approx(received + 0.03, abs=1e-4)
    assert difference("lost_ssim", "s1") == pytest.approx(0)
    page = page_of(data)
    parts = page.table("Received SSIM, TAMS minus the other, in two parts")
    assert parts.column(3)["S3, against Equal"].startswith("−0.0300 ")
    packets = page.table("how many packets").column(4)
    assert packets["S1, Equal"].startswith("4.50 ")
    (shares,) = page.tables("Share of incomplete frames")  # nothing is lost on S1
    assert "on S3," in shares.caption
    assert shares.rows[0][1] == "0.200"


def test_a_phase_without_a_complete_frame_has_no_part_in_what_loss_took() -> None:
    runner = PlantedRunner(lost_ssim={"tams": 0.05})
    changed = {"undamaged_received_ssim": None, "received_ssim": 0.1}
    data = planted_data(runner, 1, change={("tams", "s3", "GRASP"): changed}, **TWO_BY_TWO)
    measures = Measures(data)
    (lost,) = measures.values("tams", "s3", "lost_ssim")
    assert lost == pytest.approx(-0.05)
    assert measures.phases_without_complete_frames == 1
    none = {("tams", "s3", phase): changed for phase in drawing.PHASES}
    data = planted_data(runner, 1, change=none, **TWO_BY_TWO)
    assert Measures(data).values("tams", "s3", "lost_ssim") == []


def test_parts_of_a_sum_are_drawn_on_one_scale_and_an_empty_panel_does_not_set_it(
    even: StudyData,
) -> None:
    tenth = even.trials.assign(tenth=even.trials["primary_received_ssim"] / 10)
    data = StudyData(even.plan, even.config, tenth, even.practice, even.phases)
    quantities = [
        Quantity("received", "primary_received_ssim", 4),
        Quantity("a tenth of it", "tenth", 4),
        Quantity("not known", "unknown", 4),
    ]
    figure = drawing.differences_figure(Measures(data), quantities, one_scale=True)
    first, second, third = (axis.get_xlim() for axis in figure.axes)
    assert first == second == third
    assert first[1] - first[0] < 0.1  # an empty axis would be 1 wide


def test_how_sure_the_operator_was_stands_beside_what_they_relied_on(page: Page) -> None:
    sure = page.table("How sure the simulated operator was")
    assert sure.header == ["Condition", "Reach"]
    assert {*sure.column(1).values()} == {"1.25"}


def test_agreement_with_w_is_measured_and_not_assumed(page: Page) -> None:
    # the planted operator is half of the time on EIH, W's choice in four of six phases
    assert page.table("Agreement:").rows[0][1].startswith("0.42 ")
    assert page.table("fraction of glances").rows[0][1].startswith("0.60 ")


def test_the_report_is_one_page_without_links_and_its_figures_beside_it(
    page: Page, folder: Path
) -> None:
    assert not re.search(r"https?://|<script|<link|@import|url\((?!#)", page.text)
    assert "@media print" in page.text
    assert f"First {html.escape(HOSTILE, quote=False)}.".replace('"', "&#34;") in page.text
    assert f"First {HOSTILE}." in page.sentences
    assert "<h3>Remarks of those who ran the study</h3>" in page.text
    assert all(len(image.get("aria-label", "")) > 20 for image in page.images)
    assert all(image.find("svg") is not None for image in page.images)
    assert "prefers-color-scheme: dark" in page.text
    names = {path.stem for path in folder.glob("*.png")}
    assert names == {
        "ssim",
        "ssim_phases",
        "completion_time",
        "success",
        "damage",
        "differences",
        "relied_on",
    }
    assert len(page.images) == len(names)
    for path in folder.glob("*.png"):
        drawn = cv2.imread(str(path))
        assert drawn is not None
        assert drawn.std() > 5
    assert sum(path.stat().st_size for path in folder.iterdir()) < 3_000_000


def test_exported_tables_tell_the_same_as_the_study(even: StudyData, tmp_path: Path) -> None:
    write_tables(even, tmp_path)
    again = read_tables(tmp_path, small_config(**TWO_BY_TWO))
    for quantity in compared(120.0):
        first, second = (
            Measures(one).difference("equal", "s3", quantity.column) for one in (even, again)
        )
        assert first == second
    assert Measures(again).model("censored_time_s") == Measures(even).model("censored_time_s")
    assert {trial.id for trial in again.plan.trials} == {trial.id for trial in even.plan.trials}
    with pytest.raises(ConfigError, match="is not the one that the configuration plans"):
        read_tables(tmp_path, small_config(**TWO_BY_TWO, seed=12))
    with pytest.raises(ConfigError, match="cannot be read"):
        read_tables(tmp_path / "none", small_config())
    (tmp_path / "trials.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ConfigError, match="has no column trial"):
        read_tables(tmp_path, small_config())
