"""The arithmetic of the video: rates, repair, parity, frame identity, the emulated link, scores.

It knows no clock, thread, file, socket or pipeline.
"""
