"""What a glance of the seeing operator costs, here and on the reference: `GLANCE_S`.

python -m benchmarks.glance_cost
"""

from __future__ import annotations

import time
from statistics import median

import cv2

from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.seeing import OnScreen, SeeingPerception
from hw.sim.operator.task import Stage
from tams_app.runtime.machine_speed import this_machine
from tams_app.station.operator_choice import GLANCE_S
from tams_app.units import NS_PER_MS
from tests.rig_views import stored_views

_GLANCE_NS = 80 * NS_PER_MS
_FIRST = 3  # glances that search the whole images; in a session they are few
_COUNTED = 6  # as often as the container is looked for once in each view
_ROUNDS = 10


def glance_cpu_s() -> float:
    """Processor time of one glance [s], from glances at stored images."""
    images = stored_views()
    eyes = SeeingPerception(
        lambda _: OnScreen(images), EfferenceCopy(), sampling_s=0.0, delay_s=0.0
    )
    began_s = 0.0
    for glance in range(_FIRST + _COUNTED):
        if glance == _FIRST:
            began_s = time.thread_time()
        eyes.watch((glance + 1) * _GLANCE_NS, Stage.REACH)
    return (time.thread_time() - began_s) / _COUNTED


def main() -> None:
    cv2.setNumThreads(1)
    rounds = []
    for _ in range(_ROUNDS):
        this_machine.cache_clear()
        rounds.append((glance_cpu_s(), this_machine().speed))
    here_s = median(cost_s for cost_s, _ in rounds)
    reference_s = median(cost_s * speed for cost_s, speed in rounds)
    print(f"a glance takes {1e3 * here_s:.1f} ms here, {1e3 * reference_s:.1f} ms on the reference")
    print(f"the choice of the operator goes by {1e3 * GLANCE_S:.1f} ms")


if __name__ == "__main__":
    main()
