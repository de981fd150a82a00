"""`python -m tests.fuzzing TARGET SECONDS`: coverage-guided fuzzing of one target with atheris.

Without arguments, the names of the targets. A finding is written to tests/fuzzing/cases/TARGET/,
where the tests try it from then on.
"""

from __future__ import annotations

import sys
from pathlib import Path

from tests.fuzzing import CASES, TARGET_NAMES

CORPUS = Path(".fuzzing")
_INSTRUMENTED = ["tams_app", "mcap", "yaml"]


def fuzz(name: str, seconds: str) -> None:
    """Fuzz one target until the time is over or something is found."""
    import atheris

    with atheris.instrument_imports(include=_INSTRUMENTED):
        from tests.fuzzing.seeds import seeds_of
        from tests.fuzzing.targets import TARGETS

    corpus, found = CORPUS / name, CASES / name
    corpus.mkdir(parents=True, exist_ok=True)
    found.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(seeds_of(name)):
        (corpus / f"seed-{number}").write_bytes(seed)
    options = [f"-max_total_time={seconds}", f"-artifact_prefix={found}/", "-rss_limit_mb=3000"]
    options += ["-max_len=65536", "-timeout=20", "-print_final_stats=1", str(corpus)]
    atheris.Setup([sys.argv[0], *options], TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    if sys.argv[1:]:
        fuzz(*sys.argv[1:])
    else:
        sys.stdout.write(" ".join(TARGET_NAMES) + "\n")
