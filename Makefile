# make run | test | verify | newest | trixie | matrix | explore | check | bench | docs | mutate | fuzz |
# lerobot | setup | extras | lock
.DEFAULT_GOAL := run
.PHONY: run test verify newest trixie matrix explore check bench docs lock mutate fuzz setup extras installed
.PHONY: untimed short-session lerobot

# The virtual environment, and the Python that it is made with: by default the oldest supported one.
ENV := .venv
PYTHON :=
READY := $(ENV)/.ready
EXTRAS := $(ENV)/.ready-extras
PY := $(ENV)/bin/python
NODE_READY := tests/page/node_modules/.package-lock.json

run: $(READY)
	$(PY) run_tams.py $(ARGS)

check: $(EXTRAS) $(NODE_READY)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(ENV)/bin/lint-imports --no-logo
	$(PY) -m deptry .
	$(PY) -m tests.sizes
	npm run --silent --prefix tests/page check

# What checks the types of the page's JavaScript.
$(NODE_READY): tests/page/package.json tests/page/package-lock.json | $(EXTRAS)
	cd tests/page && npm ci --silent

# Beside others no test's library starts threads of its own.
ALONE := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 LP_NUM_THREADS=1
# What waits sleeps most of its time: what computes takes the rest of the machine, and no more.
IDLE := $(shell command -v chrt >/dev/null && echo chrt --idle 0)
SIDE_BY_SIDE := --dist loadfile --no-loadscope-reorder
# A change is judged by the same examples of every law on every machine; `make explore` draws new ones.
LAWS := --hypothesis-profile=steady

UNTIMED = env $(ALONE) $(PY) -m pytest $(LAWS) --group untimed --ignore=tests/teleop -m "not verify" \
	-n logical $(SIDE_BY_SIDE)

# What computes runs side by side; what keeps time has the machine to itself (see CONTRIBUTING).
test: check
ifdef ARGS
	$(PY) -m pytest $(ARGS)
else
	@mkdir -p build
	$(ALONE) $(PY) -m pytest $(LAWS) --group waiting --ignore=tests/teleop -m "not verify" -n 3 $(SIDE_BY_SIDE) \
		> build/waiting.txt 2>&1 & waiting=$$!; \
	$(IDLE) $(UNTIMED); untimed=$$?; \
	wait $$waiting; waiting=$$?; cat build/waiting.txt; [ $$untimed -eq 0 ] && [ $$waiting -eq 0 ]
	$(PY) -m pytest $(LAWS) --group timed --ignore=tests/teleop -m "not verify"
	$(PY) -m coverage run -m pytest $(LAWS) tests/teleop -m "not verify" -n logical
	$(PY) -m coverage combine --quiet
	$(PY) -m coverage report --skip-covered --fail-under=100
endif

# How often the matrix of kills, stops and cuts is run.
TIMES := 2
MATRIX := -m matrix --times $(TIMES)

# Long matrices (tests marked `verify`), the benchmarks' own tests, an installation of the package
# elsewhere, and the newest Python.
# 5 is pytest's exit code for a group in which no test is marked.
verify: $(EXTRAS) installed newest
	$(ALONE) $(PY) -m pytest $(LAWS) --group untimed -m verify -n logical $(SIDE_BY_SIDE) || [ $$? -eq 5 ]
	$(ALONE) $(PY) -m pytest $(LAWS) --group waiting -m verify -n 3 $(SIDE_BY_SIDE) || [ $$? -eq 5 ]
	$(PY) -m pytest $(LAWS) --group timed -m "verify and not matrix" || [ $$? -eq 5 ]
	$(PY) -m pytest $(LAWS) $(MATRIX)
	$(ALONE) $(PY) -m pytest $(LAWS) benchmarks/tests

# Processes killed and stopped and links cut, with the product's own limits; every run is counted.
matrix: $(EXTRAS)
	$(PY) -m pytest $(LAWS) $(MATRIX) $(ARGS)

# `pip install .` into an empty environment, and a simulated session from a folder of its own. Where
# girepository-2.0 is missing (Debian 12), a newer Python needs a PyGObject for the older one.
installed: $(READY)
	folder=$$(mktemp -d) && trap 'rm -rf "$$folder" build/lib build/bdist.* tams.egg-info' EXIT && \
		rm -rf build/lib build/bdist.* && $(PY) -m venv $$folder/venv && \
		$$folder/venv/bin/python -m pip install --quiet --disable-pip-version-check . \
			$$(pkg-config --exists girepository-2.0 || echo 'PyGObject<3.51') && \
		(cd $$folder && venv/bin/tams run --sim --headless --seconds 20)

# The newest Python of this machine that TAMS was tried with, in an environment of its own.
newest: $(READY)
	python=$$(tests/newest_python.sh) && if $(PY) -c "$(SAME_PYTHON)" $$python; then \
		echo "newest: that is the Python of $(ENV)"; \
	else \
		$(MAKE) ENV=.venv/newest PYTHON=$$python check untimed short-session installed; \
	fi

SAME_PYTHON := import subprocess, sys; \
	sys.exit(subprocess.check_output([sys.argv[1], '-V'], text=True).split()[1] != sys.version.split()[0])

untimed: $(EXTRAS)
	$(UNTIMED)

short-session: $(READY)
	$(PY) run_tams.py run --sim --headless --seconds 20

# The two commands of the README in a fresh Debian 13 in build/trixie, as root; twenty minutes.
trixie:
	tests/clean_root.sh trixie build/trixie

# The laws' tests with examples drawn anew: what fails is a defect, and its case becomes an example.
explore: $(EXTRAS)
	$(ALONE) $(PY) -m pytest -m "hypothesis and (untimed or waiting)" -n logical

# An hour or two for all modules, minutes for one (ARGS=tams_app/link/age.py) or for what the last
# run did not catch (ARGS=--again); renews tests/mutation/RESULT.txt and fails if a survivor is new or
# a module was not tried on today's code.
mutate: $(EXTRAS)
	PATH="$(CURDIR)/.venv/bin:$$PATH" nice -n 10 $(PY) -m tests.mutation $(ARGS)

# Coverage-guided fuzzing of all that reads foreign bytes, so many seconds for each target. The
# fuzzer is installed apart: nothing else needs it.
FUZZER := .venv/fuzzer
SECONDS := 600
TARGET :=

fuzz: $(FUZZER)/.ready
	for target in $(or $(TARGET),$$($(PY) -m tests.fuzzing)); do \
		nice -n 10 $(FUZZER)/bin/python -m tests.fuzzing $$target $(SECONDS) || exit 1; done

$(FUZZER)/.ready: $(EXTRAS)
	$(PY) -m venv $(FUZZER)
	$(FUZZER)/bin/python -m pip install --quiet --disable-pip-version-check 'atheris>=3,<4'
	$(PY) -c 'import sysconfig; print(sysconfig.get_path("purelib"))' > \
		"$$($(FUZZER)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/tams.pth"
	touch $@

# Every row of an exported dataset (DATASET=FOLDER) by LeRobot's own reader, whose environment takes 5 GB.
READER := .venv/lerobot
READ := import sys; from lerobot.datasets.lerobot_dataset import LeRobotDataset; \
	data = LeRobotDataset("local/tams", root=sys.argv[1]); \
	print(len([data[row] for row in range(len(data))]), "rows of", data.num_episodes, "episodes read")

lerobot: $(READER)/.ready
	HF_HUB_OFFLINE=1 $(READER)/bin/python -c '$(READ)' $(DATASET)

$(READER)/.ready: $(READY)
	python=$$(tests/newest_python.sh) && $$python -m venv $(READER)
	$(READER)/bin/python -m pip install --quiet --disable-pip-version-check 'lerobot[dataset]==0.6.*'
	touch $@

bench: $(EXTRAS)
	$(PY) -m benchmarks $(ARGS)

# The documents as a site in site/, and in it the reference of the interfaces (docs/API.md), by the
# extra `docs`, which is installed apart: nothing else needs it. The pages keep their places, so that links mean the same here as in the repository.
SITE := .venv/docs
PAGES := README.md CONTRIBUTING.md CHANGELOG.md CITATION.cff docs examples config/traces
DOCS_EXTRA := import tomllib; \
	print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"])

docs: $(SITE)/.ready
	rm -rf build/pages && mkdir -p build/pages && cp -r --parents $(PAGES) build/pages
	$(PY) run_tams.py config --explain all > build/pages/docs/CONFIGURATION.md
	$(PY) run_tams.py log fields > build/pages/docs/LOG_FIELDS.md
	$(SITE)/bin/python -m mkdocs build --quiet

$(SITE)/.ready: $(READY) pyproject.toml
	$(PY) -m venv $(SITE)
	$(SITE)/bin/python -m pip install --quiet --disable-pip-version-check \
		$$($(PY) -c '$(DOCS_EXTRA)')
	touch $@

setup: $(READY)

$(READY): setup.sh apt-packages.txt requirements.lock requirements-build.lock requirements-girepository-2.lock
	./setup.sh $(ENV) $(PYTHON)

extras: $(EXTRAS)

$(EXTRAS): $(READY) apt-packages-tests.txt requirements-extras.lock
	./setup.sh --extras $(ENV)

# The locks name versions and hashes only; where they come from is the machine's business.
COMPILE := $(PY) -m uv pip compile --universal --fork-strategy fewest --generate-hashes \
	--no-emit-index-url --quiet

lock: $(READY)
	$(PY) -m pip install --quiet uv
	@mkdir -p build
	cat requirements.lock requirements-extras.lock > build/all.lock
	$(COMPILE) --extra study --extra ros2 --extra dask --extra export --extra dev \
		-o build/all.lock pyproject.toml
	$(COMPILE) --constraints build/all.lock -o requirements.lock pyproject.toml
	awk 'NR == FNR { core[$$1] } /^[^ #]/ { other = !($$1 in core) } NR != FNR && other' \
		requirements.lock build/all.lock > requirements-extras.lock
	for group in build audit girepository-2; do \
		$(COMPILE) --group pyproject.toml:$$group -o requirements-$$group.lock || exit 1; \
	done
