# make run | make test | make setup | make bench | make check
.DEFAULT_GOAL := run
.PHONY: run test setup bench check lock

READY := .venv/.ready
PY := .venv/bin/python

run: $(READY)
	$(PY) run_tams.py $(ARGS)

test: $(READY)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -m pytest $(ARGS)

bench: $(READY)
	$(PY) -m benchmarks $(ARGS)

check: $(READY)
	$(PY) -m ruff check . && $(PY) -m ruff format --check . && $(PY) -m mypy

setup: $(READY)

$(READY): setup.sh apt-packages.txt requirements.lock
	./setup.sh

# The lock names versions and hashes only; where they come from is the machine's business.
lock: $(READY)
	$(PY) -m pip install --quiet uv
	$(PY) -m uv pip compile --universal --generate-hashes --no-emit-index-url --all-extras \
		--quiet -o requirements.lock pyproject.toml
