"""TAMS: task-aware multi-view adaptive streaming for wireless telerobotic manipulation."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("tams")
except PackageNotFoundError:  # run from a checkout that was never installed
    __version__ = "0.0.0"
