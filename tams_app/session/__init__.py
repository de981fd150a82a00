"""Builds the parts from a configuration, starts and stops them: the only place where all meet."""
