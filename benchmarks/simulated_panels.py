"""How often W has Table I's dominant view in every phase, by the noise of a simulated panel.

.venv/bin/python -m benchmarks.simulated_panels
"""

from __future__ import annotations

import numpy as np

from calibration.weights.fit import assess
from calibration.weights.panel import simulate_panel
from hw.sim.operator.rater import PANELS, PAPER_DOMINANT
from tams_app.config import load_config
from tams_app.records import Phase

PANELS_EACH = 300
RATERS = 8
NOISES = (0.5, 0.7, 1.0, 1.5, 2.0)  # points of the scale; the preference itself is 1.5


def main() -> None:
    """One line per noise, and one for a panel that prefers nothing."""
    print(f"{'panel':12} noise  as Table I  alpha of necessity, of the most critical view (median)")
    for noise in NOISES:
        print(_line("paper", noise))
    print(_line("indifferent", 0.7))


def _line(panel: str, noise: float) -> str:
    config = load_config()
    views, present = config.video.views, config.policy.weights.matrix
    hits, alphas = 0, []
    for seed in range(PANELS_EACH):
        sheets = simulate_panel(PANELS[panel], views, Phase, RATERS, seed, noise)
        result = assess(sheets, views, present)
        hits += all(row.dominant == PAPER_DOMINANT[phase] for phase, row in result.rows.items())
        alphas.append((result.necessity_alpha, result.critical_alpha))
    necessity, critical = np.nanmedian(np.array(alphas, dtype=np.float64), axis=0)  # None is NaN
    share = hits / PANELS_EACH
    return f"{panel:12} {noise:5.1f} {share:9.1%}   {necessity:6.2f} {critical:6.2f}"


if __name__ == "__main__":
    main()
