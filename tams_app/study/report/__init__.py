"""The report of a study: its numbers, its figures, and the template of its page."""
