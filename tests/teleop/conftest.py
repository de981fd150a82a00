"""How hypothesis searches: anew each time, or (for mutation testing) always the same way."""

from hypothesis import settings

settings.register_profile("unhurried", deadline=None)  # a busy machine breaks no promise
settings.load_profile("unhurried")

# `--hypothesis-profile=steady`: a mutant must die by a test, not by this run's luck.
settings.register_profile("steady", derandomize=True, database=None, deadline=None)
