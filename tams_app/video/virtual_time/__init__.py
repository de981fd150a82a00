"""The three views in lock-step under a virtual clock: the real chains, one event at a time."""
