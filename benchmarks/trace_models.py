"""Making capacity traces: outages, a step, a sawtooth, a Markov chain, LTE; 100 ms a row.

`python -m benchmarks.trace_models outage --seed 1 > outage.csv` writes one.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from itertools import islice
from random import Random

from tams_app.video.live.networks import CSV_HEADER

ROW_MS = 100


def outage_kbps(
    random: Random,
    rate_kbps: int = 6000,
    mean_gap_s: float = 8.0,
    shortest_s: float = 0.3,
    longest_s: float = 2.0,
) -> Iterator[int]:
    """`rate_kbps`, broken by outages of uniform length, exponential gaps of `mean_gap_s` apart."""
    while True:
        yield from [rate_kbps] * _rows(random.expovariate(1.0 / mean_gap_s))
        yield from [0] * _rows(random.uniform(shortest_s, longest_s))


def step_kbps(
    _random: Random, high_kbps: int = 12_000, low_kbps: int = 3000, hold_s: float = 10.0
) -> Iterator[int]:
    """`high_kbps` and `low_kbps` in turn, `hold_s` each; nothing is random."""
    while True:
        yield from [high_kbps] * _rows(hold_s)
        yield from [low_kbps] * _rows(hold_s)


def sawtooth_kbps(
    _random: Random, low_kbps: int = 2000, high_kbps: int = 10_000, rise_s: float = 10.0
) -> Iterator[int]:
    """A linear rise from `low_kbps` to `high_kbps` in `rise_s`, then down at once; not random."""
    rows = _rows(rise_s)
    while True:
        for row in range(rows):
            yield low_kbps + (high_kbps - low_kbps) * row // max(1, rows - 1)


def markov_kbps(
    random: Random,
    states_kbps: tuple[int, ...] = (1500, 3000, 6000, 12_000),
    mean_dwell_s: float = 2.0,
) -> Iterator[int]:
    """A walk between neighbouring states, each held for an exponential time of `mean_dwell_s`."""
    state = random.randrange(len(states_kbps))
    while True:
        yield from [states_kbps[state]] * _rows(random.expovariate(1.0 / mean_dwell_s))
        neighbours = [n for n in (state - 1, state + 1) if 0 <= n < len(states_kbps)]
        state = random.choice(neighbours)


def lte_kbps(random: Random) -> Iterator[int]:
    """An LTE uplink in a moving car, with the statistics of AT&T's of 2016 (Mahimahi).

    The logarithm of the rate has a standard deviation of .91 and correlations of .45, .27 and .24
    after .1, .2 and 1 s: a slow part and one that is new in nearly every row. One row in 40 is
    empty by itself; outages of .8 to 4 s are 13 s apart.
    """
    rates = _log_normal_kbps(random, 1500.0, (0.5, 0.97), (0.76, 0.28))
    while True:
        for kbps in islice(rates, _rows(random.expovariate(1.0 / 13.0))):
            yield 0 if random.random() < 0.025 else kbps
        yield from [0] * _rows(random.triangular(0.8, 4.0, 1.0))


def still_kbps(random: Random) -> Iterator[int]:
    """An LTE uplink at rest: half as unsteady, with gaps of .2 to .8 s that are 20 s apart."""
    rates = _log_normal_kbps(random, 5500.0, (0.5, 0.975), (0.3, 0.6))
    while True:
        yield from islice(rates, _rows(random.expovariate(1.0 / 20.0)))
        yield from [0] * _rows(random.uniform(0.2, 0.8))


def _log_normal_kbps(
    random: Random, median_kbps: float, *parts: tuple[float, float]
) -> Iterator[int]:
    """Rates of which the logarithm is a sum of stationary chains of the first order.

    `parts`: of each its standard deviation and the correlation of one row with the next.
    """
    values = [random.gauss(0.0, deviation) for deviation, _ in parts]
    while True:
        values = [
            kept * value + random.gauss(0.0, deviation * math.sqrt(1.0 - kept**2))
            for value, (deviation, kept) in zip(values, parts, strict=True)
        ]
        yield min(round(median_kbps * math.exp(sum(values))), 40_000)


MODELS: dict[str, Callable[[Random], Iterator[int]]] = {
    "outage": outage_kbps,
    "step": step_kbps,
    "sawtooth": sawtooth_kbps,
    "markov": markov_kbps,
    "lte": lte_kbps,
    "still": still_kbps,
}


def generate(model: str, seed: int, seconds: float) -> str:
    """A trace file's text: `model` is one of `MODELS`; the same arguments, the same bytes."""
    rates = MODELS[model](Random(f"{seed}/{model}"))
    rows = islice(rates, _rows(seconds))
    lines = (f"{row * ROW_MS},{kbps}" for row, kbps in enumerate(rows))
    return "\n".join((CSV_HEADER, *lines)) + "\n"


def _rows(seconds: float) -> int:
    return max(1, round(seconds * 1000 / ROW_MS))


def main(arguments: list[str] | None = None) -> None:
    """Write a trace to standard output."""
    parser = argparse.ArgumentParser(prog="trace_models", description="Make a capacity trace.")
    parser.add_argument("model", choices=sorted(MODELS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60.0)
    chosen = parser.parse_args(arguments)
    sys.stdout.write(generate(chosen.model, chosen.seed, chosen.seconds))


if __name__ == "__main__":
    main()
