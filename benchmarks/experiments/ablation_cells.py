"""The cells of the ablation table: what is varied, and the configuration of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from tams_app.config import Config, load_config
from tams_app.video.core.repair import repair_rule
from tams_app.video.live.networks import resolve_network

ALLOCATIONS = ("equal", "static", "tams")
PRESETS = ("ultrafast", "superfast", "veryfast")
REPAIRS = {
    "RTX and PLI": ("on", True),
    "RTX": ("on", False),
    "PLI": ("off", True),
    "none": ("off", False),
}
FACTORS = {"allocation": ALLOCATIONS, "preset": PRESETS, "repair": tuple(REPAIRS)}


@dataclass(frozen=True, slots=True)
class Cell:
    """One combination of the three."""

    allocation: str
    preset: str
    repair: str

    @property
    def name(self) -> str:
        return f"{self.allocation}, {self.preset}, {self.repair}"

    def settings(self) -> dict[str, Any]:
        """As dotted keys of the configuration."""
        rtx, pli = REPAIRS[self.repair]
        return {
            "strategy": self.allocation,
            "video.preset": self.preset,
            "video.repair.rtx": rtx,
            "video.repair.pli": pli,
        }


def product_cell(network: str) -> Cell:
    """What the product does on `network` by default."""
    config = load_config()
    rule = repair_rule(resolve_network(config, network), config.video.pli_min_interval_ms)
    return Cell(config.strategy, config.video.preset, "RTX and PLI" if rule.rtx else "PLI")


def one_at_a_time(centre: Cell) -> Iterator[Cell]:
    """`centre`, then all that differ from it in one factor."""
    yield centre
    for factor, levels in FACTORS.items():
        for level in levels:
            cell = replace(centre, **{factor: level})
            if cell != centre:
                yield cell


def every() -> Iterator[Cell]:
    """All combinations."""
    for allocation, preset, repair in product(*FACTORS.values()):
        yield Cell(allocation, preset, repair)


def configure(cell: Cell, network: str, seed: int, hand: Path, seconds: float) -> Config:
    """A replay of `hand`, recorded on the scene of `seed`, of at most `seconds`."""
    return load_config(
        None,
        {
            **cell.settings(),
            "network": network,
            "policy.budget.mode": "oracle",
            "video.repair.mode": "paper",
            "seed": seed,
            "seconds": seconds,
            "headless": True,
            "rig.hand_trajectory": str(hand),
            "recording.bitstream": False,
        },
    )
