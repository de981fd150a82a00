"""Sessions: the parts built from a configuration, started, watched and stopped, live or virtual."""

__all__ = ["session", "virtual"]
