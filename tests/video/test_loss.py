"""Which packets a link loses."""

from itertools import groupby
from random import Random

import pytest

from tams_app.config import Network
from tams_app.video.core.link import GilbertElliottLoss, loss_model

pytestmark = pytest.mark.untimed

PACKETS = 200_000


def fates(probability, mean_burst, seed=3):
    model = loss_model(probability, mean_burst, Random(seed))
    return [model.lost() for _ in range(PACKETS)]


def mean_run(lost):
    runs = [len(list(run)) for fate, run in groupby(lost) if fate]
    return sum(runs) / len(runs)


@pytest.mark.parametrize("probability", [0.003, 0.01, 0.2])
@pytest.mark.parametrize("mean_burst", [1.0, 3.0, 8.0])
def test_the_long_run_loss_is_the_one_asked_for(probability, mean_burst):
    share = sum(fates(probability, mean_burst)) / PACKETS
    # four standard errors of the mean, widened by the correlation within bursts
    tolerance = 4 * (probability * (2 * mean_burst) / PACKETS) ** 0.5
    assert abs(share - probability) < tolerance


@pytest.mark.parametrize("mean_burst", [3.0, 8.0])
def test_losses_come_in_bursts_of_the_mean_length(mean_burst):
    assert mean_run(fates(0.02, mean_burst)) == pytest.approx(mean_burst, rel=0.1)


def test_independent_losses_are_no_bursts():
    assert mean_run(fates(0.02, 1.0)) == pytest.approx(1 / 0.98, rel=0.02)


@pytest.mark.parametrize("mean_burst", [1.0, 4.0])
@pytest.mark.parametrize(("probability", "lost"), [(0.0, 0), (1.0, PACKETS)])
def test_none_and_all_mean_none_and_all(probability, lost, mean_burst):
    assert sum(fates(probability, mean_burst)) == lost


def test_impossible_bursts_are_refused_by_the_model_and_the_configuration():
    with pytest.raises(ValueError, match="such short bursts"):
        GilbertElliottLoss(0.9, 2.0, Random(0))
    with pytest.raises(ValueError, match="cannot come in bursts of 2"):
        Network(loss=0.9, loss_burst=2.0)
    assert Network(loss=0.9, loss_burst=9.1).loss_burst == 9.1
