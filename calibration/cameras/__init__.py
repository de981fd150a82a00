"""Which camera is which, whether it sees well, when it saw, and through which lens."""
