"""What the paper reports of sixteen people (section V), to stand beside a study's figures."""

from __future__ import annotations

from collections.abc import Mapping

Cells = Mapping[tuple[str, str], float]  # by (strategy, network)

SOURCE = "paper, 16 people on hardware"

_STRATEGIES = ("equal", "static", "tams")


def _cells(**rows: tuple[float, float, float]) -> Cells:
    """The paper's columns by network."""
    return {
        (strategy, network): value
        for network, values in rows.items()
        for strategy, value in zip(_STRATEGIES, values, strict=True)
    }


RECEIVED_SSIM = _cells(s1=(0.944, 0.951, 0.968), s2=(0.862, 0.879, 0.904), s3=(0.764, 0.778, 0.794))
COMPLETION_TIME_S = _cells(s1=(24.7, 23.4, 23.5), s2=(34.8, 31.7, 28.1), s3=(68.9, 52.1, 43.9))
# s1: the paper gives the range 90–92 % only
SUCCESS_SHARE = _cells(s2=(0.73, 0.79, 0.88), s3=(0.48, 0.60, 0.71))
COHENS_D: Mapping[str, float] = {"s2": -0.72, "s3": -1.38}
INTERACTION = "tams × s3"
INTERACTION_BETA_S, INTERACTION_SE_S = -23.47, 3.22


def success_text(strategy: str, network: str) -> str:
    """The paper's success rate as it is printed; a dash where it gives none."""
    share = SUCCESS_SHARE.get((strategy, network))
    if share is not None:
        return f"{100 * share:.0f} %"
    return "90–92 %" if network == "s1" and (strategy, network) in COMPLETION_TIME_S else "–"
