"""The devices: one interface each, the drivers, and a simulated rig."""

__all__ = ["arm", "camera", "controller"]
