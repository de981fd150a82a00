"""Finished experiments, outside `make bench`: `python -m benchmarks.experiments.NAME`."""
