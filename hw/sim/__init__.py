"""The simulated rig: everything beyond the wire, and a feature of the product."""
