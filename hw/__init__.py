"""The devices: one interface each, the real driver, and a virtual one."""
