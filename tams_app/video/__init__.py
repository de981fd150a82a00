"""Three H.264 streams over one uplink: senders, receivers, the emulated link, quality.

Modules load GStreamer only when a pipeline is made.
"""
