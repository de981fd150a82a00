"""The rule for W, and agreement between raters against published worked examples."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calibration.weights.fit import assess, fit_weights, krippendorff_alpha
from calibration.weights.ratings import (
    LEAST,
    MOST,
    PAPER_DOMINANT,
    RatedPhase,
    Sheet,
    simulate_panel,
)
from tams_app.config import load_config
from tams_app.records import Phase

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt", "gs")
PRESENT = load_config().policy.weights.matrix
POINTS = st.integers(LEAST, MOST)
FEW = settings(max_examples=40)  # to draw a panel takes its time


@st.composite
def panels(draw, views=VIEWS, may_be_silent=True):
    """Any sheets on REACH at all, also with things unsaid."""
    silence = st.none() if may_be_silent else st.nothing()
    answer = st.builds(
        RatedPhase,
        phase=st.just(Phase.REACH),
        necessity=st.fixed_dictionaries(dict.fromkeys(views, POINTS | silence)),
        most_critical=st.sampled_from(views) | silence,
    )
    answers = draw(st.lists(answer, min_size=1, max_size=12))
    return [
        Sheet(rater=f"p{number}", simulated=False, answers=(one,))
        for number, one in enumerate(answers)
    ]


def answer(points, named):
    necessity = dict(zip(VIEWS, points, strict=True))
    return RatedPhase(phase=Phase.REACH, necessity=necessity, most_critical=named)


def ballot(*answers):
    """Sheets from (necessity in the order of VIEWS, most critical view)."""
    return [
        Sheet(rater=f"p{n}", simulated=False, answers=(answer(points, named),))
        for n, (points, named) in enumerate(answers)
    ]


def reach(sheets, views=VIEWS, present=PRESENT):
    return fit_weights(sheets, views, present)[Phase.REACH]


def mean(sheets, view):
    given_ = [v for s in sheets if (v := s.answers[0].necessity[view]) is not None]
    return Fraction(sum(given_), len(given_))


@FEW
@given(panels(may_be_silent=False))
def test_the_other_shares_are_ordered_by_necessity_and_equal_where_it_is(sheets):
    row = reach(sheets)
    first, second = (view for view in VIEWS if view != row.dominant)
    more = mean(sheets, first) - mean(sheets, second)
    gap = row.shares[first] - row.shares[second]
    assert gap >= 0 if more > 0 else gap <= 0 if more < 0 else gap == 0


@FEW
@given(st.integers(1, 9).flatmap(lambda n: panels(tuple(f"v{i}" for i in range(n)), False)))
def test_a_row_sums_to_one_and_the_most_often_named_view_leads_for_any_number_of_views(sheets):
    views = tuple(sheets[0].answers[0].necessity)
    present = {phase: {view: 1 / len(views) for view in views} for phase in Phase}
    row = reach(sheets, views, present)
    shares = sorted(row.shares.values())
    exact = [Decimal(str(share)) for share in shares]
    assert sum(exact) == 1
    assert all(share == share.quantize(Decimal("0.01")) for share in exact)
    assert row.votes[row.dominant] == max(row.votes.values())
    assert shares[0] >= (60 // len(views)) / 100 > 0
    assert row.shares[row.dominant] == shares[-1]
    assert len(views) == 1 or shares[-1] > shares[-2]


@FEW
@given(panels())
def test_a_row_is_built_or_kept_and_says_why_it_was_kept(sheets):
    row = reach(sheets)
    if row.dominant is None:
        assert row.shares == PRESENT[Phase.REACH]
        assert "keeps its present row" in row.remarks[0]
    else:
        assert row.votes[row.dominant] > 0
        assert None not in row.necessity.values()


@FEW
@given(panels(may_be_silent=False), st.randoms())
def test_the_order_of_the_raters_does_not_matter(sheets, random):
    shuffled = list(sheets)
    random.shuffle(shuffled)
    assert reach(shuffled) == reach(sheets)


@FEW
@given(panels(may_be_silent=False))
def test_one_more_vote_for_the_dominant_view_never_lowers_its_share(sheets):
    row = reach(sheets)
    voted = dict.fromkeys(VIEWS)  # the vote only, so that the necessities stay
    vote = RatedPhase(phase=Phase.REACH, necessity=voted, most_critical=row.dominant)
    more = [*sheets, Sheet(rater="more", simulated=False, answers=(vote,))]
    assert reach(more).shares[row.dominant] >= row.shares[row.dominant]


def test_unanimous_raters_give_table_ones_largest_share_and_evenly_split_ones_its_smallest():
    unanimous = reach(ballot(*[((5, 3, 3), "eih")] * 8))
    assert unanimous.shares == {"eih": 0.60, "gt": 0.20, "gs": 0.20}
    split = reach(ballot(((3, 5, 3), "eih"), ((3, 4, 3), "gt"), ((3, 3, 3), "gs")))
    assert split.dominant == "gt"
    assert split.shares["gt"] == pytest.approx(0.45, abs=0.0101)


EVEN = {phase: {"eih": 0.6, "gt": 0.2, "gs": 0.2} for phase in Phase}


@pytest.mark.parametrize(
    ("answers", "present", "dominant", "remarks"),
    [
        (  # broken by necessity
            (((5, 4, 1), "eih"), ((4, 4, 1), "gt")),
            PRESENT,
            "eih",
            ("tie: eih and gt", "eih is the more necessary"),
        ),
        (  # by the one with more in the present row
            (((4, 4, 1), "eih"), ((4, 4, 1), "gt")),
            PRESENT,
            "gt",
            ("gt is taken for its present share: ask more raters",),
        ),
        (  # by nothing
            (((1, 4, 4), "gs"), ((1, 4, 4), "gt")),
            EVEN,
            "gt",
            ("gt is taken for it is named first: ask more raters",),
        ),
        (
            (((2, 5, 3), "eih"), ((2, 5, 3), "eih")),
            PRESENT,
            "eih",
            ("eih is most often named most critical, but gt and gs are rated more necessary",),
        ),
        (
            (((5, 3, 3), "eih"), ((5, 3, 3), "eih"), ((3, 5, 3), "gt"), ((3, 3, 5), "gs")),
            PRESENT,
            "eih",
            ("no majority: 2 of 4 named eih most critical",),
        ),
        (
            (((5, None, 3), "eih"), ((4, None, 2), "eih")),
            PRESENT,
            None,
            ("keeps its present row: no rater rated the necessity of gt",),
        ),
    ],
)
def test_ties_disagreement_and_gaps_are_decided_and_told(answers, present, dominant, remarks):
    row = reach(ballot(*answers), present=present)
    assert row.dominant == dominant
    assert all(words in "\n".join(row.remarks) for words in remarks)


@pytest.mark.parametrize("seed", range(20))
def test_a_simulated_panel_gets_table_ones_dominant_view_in_every_phase(seed):
    sheets = simulate_panel(VIEWS, seed)
    rows = assess(sheets, VIEWS, PRESENT).rows
    assert {phase: row.dominant for phase, row in rows.items()} == PAPER_DOMINANT


def test_the_papers_dominant_views_are_those_of_the_configured_table_one():
    for phase, row in PRESENT.items():
        assert max(row, key=lambda view: row[view]) == PAPER_DOMINANT[phase]


def test_few_and_simulated_raters_are_told():
    sheets = simulate_panel(VIEWS, 1, raters=2)
    sheets.append(Sheet(rater="p01", simulated=False, answers=sheets[0].answers))
    remarks = assess(sheets, VIEWS, PRESENT).all_remarks
    assert "2 of 3 ratings are of a simulated panel, not of people" in remarks
    assert "few raters: 3, where the paper asked 8" in remarks
    alone = assess(sheets[:1], VIEWS, PRESENT)
    assert alone.necessity_alpha is None
    assert "not defined" in alone.unfounded


# --- agreement ---------------------------------------------------------------------------------

N = np.nan
# Krippendorff (2011): four observers, twelve units, some values missing
KRIPPENDORFF = np.array(
    [
        [1, 2, 3, 3, 2, 1, 4, 1, 2, N, N, N],
        [1, 2, 3, 3, 2, 2, 4, 1, 2, 5, N, 3],
        [N, 3, 3, 3, 2, 3, 4, 2, 2, 5, 1, N],
        [1, 2, 3, 3, 2, 4, 4, 1, 2, 5, 1, N],
    ]
)


@pytest.mark.parametrize(("metric", "published"), [("nominal", 0.743), ("ordinal", 0.815)])
def test_alpha_is_what_krippendorff_computes_for_his_example(metric, published):
    assert krippendorff_alpha(KRIPPENDORFF, metric) == pytest.approx(published, abs=5e-4)


ratings = arrays(
    np.float64,
    st.tuples(st.integers(2, 5), st.integers(2, 6)),
    elements=st.sampled_from([1.0, 2.0, 3.0, 4.0, 5.0, N]),
)


@given(ratings, st.permutations([0, 1, 2, 3, 4]))
def test_renaming_categories_leaves_the_nominal_alpha_and_stretching_a_scale_the_ordinal_one(
    values, order
):
    given_ = np.isfinite(values)
    renamed, stretched = values.copy(), values.copy()
    renamed[given_] = np.array(order)[values[given_].astype(int) - 1]
    stretched[given_] = values[given_] ** 3
    for metric, changed in (("nominal", renamed), ("ordinal", stretched)):
        before = krippendorff_alpha(values, metric)
        assert krippendorff_alpha(changed, metric) == (
            None if before is None else pytest.approx(before, abs=1e-9)
        )


@pytest.mark.parametrize("values", [np.full((3, 4), 2.0), np.array([[1.0, N], [N, 2.0]])])
def test_alpha_is_undefined_without_variation_or_without_a_unit_rated_twice(values):
    assert krippendorff_alpha(values, "ordinal") is None
