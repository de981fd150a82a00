"""Studies: design, plan, trials, statistics, report."""

__all__ = ["cli", "plan", "planning", "runner"]
