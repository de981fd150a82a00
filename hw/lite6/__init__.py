"""UFACTORY's Lite 6 through the xArm-Python-SDK."""

__all__ = ["arm", "discovery", "kinematics"]
