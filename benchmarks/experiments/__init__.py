"""Finished experiments, outside `make bench`: `benchmarks.experiments.NAME` at 628dd78b."""
