"""Studies: design, plan, trials, statistics, report."""

__all__ = ["cli", "design", "plan", "runner", "trial"]
