"""USB cameras through V4L2 and GStreamer."""

__all__ = ["devices"]
