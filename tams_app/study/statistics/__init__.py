"""Statistics of a study: pure functions over numbers; intervals are 95 %."""
