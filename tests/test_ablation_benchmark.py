"""The arithmetic of the ablation table."""

from __future__ import annotations

import pytest

from benchmarks.ablation_cells import FACTORS, Cell, every, one_at_a_time, product_cell
from benchmarks.ablation_table import ranges, rows
from tams_app.config import load_config

pytestmark = pytest.mark.untimed

PRODUCT = Cell("tams", "superfast", "PLI")
EQUAL = Cell("equal", "superfast", "PLI")
FAST = Cell("tams", "ultrafast", "PLI")
OTHER = Cell("equal", "ultrafast", "none")


def figures(received: float | None, live: float = 0.5) -> dict[str, float | None]:
    return {"received_ssim": received, "live_ssim": live}


def test_one_factor_at_a_time_leaves_the_two_others_as_the_product_has_them():
    cells = list(one_at_a_time(PRODUCT))
    assert cells[0] == PRODUCT
    assert len(cells) == len(set(cells)) == 1 + sum(len(levels) - 1 for levels in FACTORS.values())
    for cell in cells[1:]:
        assert sum(getattr(cell, name) != getattr(PRODUCT, name) for name in FACTORS) == 1


def test_all_combinations_hold_the_products():
    assert set(one_at_a_time(PRODUCT)) <= set(every())
    assert len(list(every())) == 36


def test_the_products_cell_is_what_its_rules_give_on_each_network():
    assert {product_cell(name).repair for name in ("s1", "s2")} == {"RTX and PLI"}
    assert product_cell("s3") == Cell("tams", load_config().video.preset, "PLI")


def test_every_cell_is_a_valid_configuration():
    for cell in every():
        config = load_config(None, cell.settings())
        assert config.video.preset == cell.preset
        assert config.strategy == cell.allocation
        assert (config.video.repair.rtx == "on") == ("RTX" in cell.repair)
        assert config.video.repair.pli == ("PLI" in cell.repair)


def test_cells_are_compared_with_the_product_seed_by_seed():
    trials = {
        PRODUCT: {0: figures(0.90), 1: figures(0.70), 2: figures(None)},
        EQUAL: {0: figures(0.88), 1: figures(0.66), 2: figures(0.1)},
    }
    product, equal = rows("s3", PRODUCT, trials)
    assert product.is_product
    assert product.against is None
    assert product.means["received_ssim"] == pytest.approx(0.80)
    assert equal.against is not None
    assert (equal.against.value, equal.against.n) == (pytest.approx(-0.03), 2)
    assert equal.against.low < -0.03 < equal.against.high


def test_a_factors_range_is_over_the_cells_that_differ_in_it_alone():
    trials = {
        PRODUCT: {0: figures(0.80)},
        EQUAL: {0: figures(0.83)},
        FAST: {0: figures(0.60)},
        OTHER: {0: figures(0.10)},
    }
    found = {one.factor: one for one in ranges(rows("s3", PRODUCT, trials), ["received_ssim"])}
    assert found["allocation"].range == pytest.approx(0.03)
    assert (found["allocation"].best, found["allocation"].worst) == ("equal", "tams")
    assert found["preset"].range == pytest.approx(0.20)
    assert found["repair"].range == 0.0


def test_a_measure_that_no_trial_has_is_none():
    (row,) = rows("s3", PRODUCT, {PRODUCT: {0: figures(None), 1: figures(None)}})
    assert row.means["received_ssim"] is None
