"""TAMS: task-aware multi-view adaptive streaming for wireless telerobotic manipulation."""

__version__ = "0.1.0"
