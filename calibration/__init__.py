"""Measuring a setup: the wizards behind `run_tams.py calibrate`, and the fits they rest on."""

__all__ = ["cli", "store"]
