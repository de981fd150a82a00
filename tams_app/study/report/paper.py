"""What the paper reports of sixteen people (section V), to stand beside a study's figures."""

from __future__ import annotations

from collections.abc import Mapping

Cells = Mapping[tuple[str, str], float]  # by (strategy, network)

SOURCE = "paper, 16 people on hardware"

RECEIVED_SSIM: Cells = {
    ("equal", "s1"): 0.944,
    ("static", "s1"): 0.951,
    ("tams", "s1"): 0.968,
    ("equal", "s2"): 0.862,
    ("static", "s2"): 0.879,
    ("tams", "s2"): 0.904,
    ("equal", "s3"): 0.764,
    ("static", "s3"): 0.778,
    ("tams", "s3"): 0.794,
}
COMPLETION_TIME_S: Cells = {
    ("equal", "s1"): 24.7,
    ("static", "s1"): 23.4,
    ("tams", "s1"): 23.5,
    ("equal", "s2"): 34.8,
    ("static", "s2"): 31.7,
    ("tams", "s2"): 28.1,
    ("equal", "s3"): 68.9,
    ("static", "s3"): 52.1,
    ("tams", "s3"): 43.9,
}
# s1: the paper gives the range 90–92 % only
SUCCESS_SHARE: Cells = {
    ("equal", "s2"): 0.73,
    ("static", "s2"): 0.79,
    ("tams", "s2"): 0.88,
    ("equal", "s3"): 0.48,
    ("static", "s3"): 0.60,
    ("tams", "s3"): 0.71,
}
COHENS_D: Mapping[str, float] = {"s2": -0.72, "s3": -1.38}
INTERACTION = "tams × s3"
INTERACTION_BETA_S, INTERACTION_SE_S = -23.47, 3.22


def success_text(strategy: str, network: str) -> str:
    """The paper's success rate as it is printed; a dash where it gives none."""
    share = SUCCESS_SHARE.get((strategy, network))
    if share is not None:
        return f"{100 * share:.0f} %"
    return "90–92 %" if network == "s1" and (strategy, network) in COMPLETION_TIME_S else "–"
