"""The control loop with the real teleoperation and the in-process arm, under a virtual clock."""

PERIOD_NS = 1_000_000_000 // 120
