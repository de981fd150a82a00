"""The devices: one interface each, the drivers, and a simulated rig.

An application needs the interfaces, which are modules of their own so that a helper process
loads no more than it uses.
"""

__all__ = ["arm", "camera", "controller"]
