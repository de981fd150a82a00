"""The terminal: one line that lives, and the keys of an experimenter."""
