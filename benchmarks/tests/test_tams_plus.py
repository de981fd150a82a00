"""Which trials compare `tams+` with `tams`, and how."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.experiments import tams_plus
from benchmarks.experiments.tams_plus import MEASURES, STRATEGIES, Trial, link, plan, rows
from tams_app.config import load_config
from tams_app.video.live.networks import resolve_network

pytestmark = pytest.mark.untimed


def test_all_but_the_strategy_is_the_same_in_a_pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tams_plus, "length_s", lambda _hand: 20.0)
    hands = {seed: tmp_path / str(seed) for seed in (0, 1)}
    trials = list(plan(("s1", "s3"), hands, tmp_path, None))
    assert [trial.strategy for trial in trials] == [*STRATEGIES] * 4
    for plain, other in zip(trials[::2], trials[1::2], strict=True):
        assert other.config.strategy == "tams+"
        assert plain.config == other.config.model_copy(update={"strategy": "tams"})


def test_with_each_seed_a_trace_begins_later_on_the_same_link(tmp_path: Path) -> None:
    trace = tmp_path / "fall.csv"
    trace.write_text("t_ms,kbps\n" + "".join(f"{t},{t + 1}\n" for t in range(0, 100_000, 100)))
    config = load_config(None, link(str(trace), None, 2, tmp_path))
    network = resolve_network(config, config.network)
    assert network.loss == config.networks["s2"].loss
    assert Path(network.trace or "").read_text().split()[:2] == ["t_ms,kbps", "0,50001"]


def test_a_named_network_keeps_all_but_the_loss_that_is_asked_for(tmp_path: Path) -> None:
    config = load_config(None, link("s3", 0.0, 0, tmp_path))
    own = load_config().networks["s3"]
    assert config.networks["s3"] == own.model_copy(update={"loss": 0.0})


def test_differences_are_those_to_tams_seed_by_seed() -> None:
    config = load_config()
    trials = [Trial("s2", one, seed, config) for one in STRATEGIES for seed in (0, 1)]
    values = dict(zip((trial.id for trial in trials), (0.1, 0.5, 0.2, 0.8), strict=True))
    found = {name: dict.fromkeys(MEASURES, value) for name, value in values.items()}
    (reference, plus) = (row for row in rows(trials, found) if row.measure == "primary live")
    assert reference.difference is None
    assert plus.difference is not None
    assert plus.difference.value == pytest.approx(0.2)
