# make run | make test | make setup | make bench | make check | make mutate
.DEFAULT_GOAL := run
.PHONY: run test setup bench check lock mutate

READY := .venv/.ready
PY := .venv/bin/python

run: $(READY)
	$(PY) run_tams.py $(ARGS)

# Beside others no test's library starts threads of its own.
ALONE := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 LP_NUM_THREADS=1
SIDE_BY_SIDE := --dist loadfile --no-loadscope-reorder

# What computes runs side by side; what keeps time has the machine to itself (see CONTRIBUTING).
test: $(READY)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
ifdef ARGS
	$(PY) -m pytest $(ARGS)
else
	$(ALONE) $(PY) -m pytest --ignore=tests/teleop -m untimed -n logical $(SIDE_BY_SIDE)
	$(ALONE) $(PY) -m pytest --ignore=tests/teleop -m waiting -n 3 $(SIDE_BY_SIDE)
	$(PY) -m pytest --ignore=tests/teleop -m timed
	$(PY) -m coverage run -m pytest tests/teleop -n logical
	$(PY) -m coverage combine --quiet
	$(PY) -m coverage report --skip-covered --fail-under=100
endif

# An hour or two; writes tests/mutation/RESULT.txt and fails if a survivor is not explained.
mutate: $(READY)
	PATH="$(CURDIR)/.venv/bin:$$PATH" nice -n 10 $(PY) -m mutmut run --max-children 1
	$(PY) -m tests.mutation

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
