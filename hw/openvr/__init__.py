"""Tracked controllers through OpenVR (SteamVR)."""

__all__ = ["controller", "devices"]
