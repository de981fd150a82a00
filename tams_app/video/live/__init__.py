"""The video of a live session: GStreamer, sockets, files, shared memory and helper processes.

Modules load GStreamer only when a pipeline is made.
"""
