"""Making capacity traces."""

import math
from itertools import groupby, pairwise
from statistics import stdev

import pytest

from benchmarks.trace_models import MODELS, generate, main
from tams_app.config import CONFIG_DIRECTORY
from tams_app.units import NS_PER_S
from tams_app.video.live.networks import parse_trace

pytestmark = pytest.mark.untimed


def rates(model: str, seed: int = 1, seconds: float = 600.0) -> tuple[float, ...]:
    return parse_trace(generate(model, seed, seconds), model).kbps


@pytest.mark.parametrize("model", sorted(MODELS))
def test_the_shipped_trace_is_what_its_command_makes(
    model: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main([model, "--seed", "1"])
    assert capsys.readouterr().out == (CONFIG_DIRECTORY / "traces" / f"{model}.csv").read_text()


@pytest.mark.parametrize("model", sorted(MODELS))
def test_a_trace_lasts_as_long_as_asked(model: str) -> None:
    assert parse_trace(generate(model, 1, 12.3), model).period_ns == round(12.3 * NS_PER_S)


@pytest.mark.parametrize("model", ["outage", "markov", "lte", "still"])
def test_the_seed_makes_the_trace(model: str) -> None:
    assert generate(model, 5, 100) == generate(model, 5, 100) != generate(model, 6, 100)


def test_outages_are_as_long_as_documented() -> None:
    outages = [len(list(run)) for rate, run in groupby(rates("outage")) if rate == 0]
    assert len(outages) > 20
    assert min(outages[:-1]) >= 3
    assert max(outages) <= 20
    assert set(rates("outage")) == {0.0, 6000.0}


def test_the_step_holds_each_rate_for_ten_seconds() -> None:
    runs = [(rate, len(list(run))) for rate, run in groupby(rates("step", seconds=40))]
    assert runs == [(12_000.0, 100), (3000.0, 100)] * 2


def test_the_sawtooth_rises_evenly_and_falls_at_once() -> None:
    sawtooth = rates("sawtooth", seconds=20)
    assert (min(sawtooth), max(sawtooth)) == (2000.0, 10_000.0)
    assert [second < first for first, second in pairwise(sawtooth)].count(True) == 1


def test_the_markov_walk_moves_between_neighbours_and_dwells() -> None:
    states = (1500.0, 3000.0, 6000.0, 12_000.0)
    walk = [states.index(rate) for rate in rates("markov", seconds=2000)]
    runs = [len(list(run)) for _, run in groupby(walk)]
    assert set(walk) == {0, 1, 2, 3}
    assert all(abs(second - first) <= 1 for first, second in pairwise(walk))
    assert sum(runs) / len(runs) / 10 == pytest.approx(2.0, rel=0.2)


def test_the_models_of_lte_have_the_statistics_documented() -> None:
    driving, still = rates("lte", seconds=2000), rates("still", seconds=2000)
    for trace, deviation, mean in ((driving, 0.91, 1900), (still, 0.58, 6300)):
        logarithms = [math.log(rate) for rate in trace if rate]
        assert stdev(logarithms) == pytest.approx(deviation, rel=0.1)
        assert sum(trace) / len(trace) == pytest.approx(mean, rel=0.25)
    outages = [len(list(run)) for rate, run in groupby(driving) if rate == 0]
    assert max(outages) == pytest.approx(40, abs=5)
    assert sum(length >= 8 for length in outages) > 60
