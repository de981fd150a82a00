"""The thresholds and dwell times of Algorithm 1, from trials whose phases are known."""
