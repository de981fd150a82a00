"""What the proof needs, outside `make bench`: `python -m benchmarks.experiments.NAME`."""
