# make demo · make test · make lint · make bench — each sets up what it needs; a second run does no work again.
SHELL := /bin/bash
PYTHON ?= python3
RUN := source env.sh &&
SEED ?=
DEMO_OUT ?= runs/demo
PYTEST_ARGS ?=

PACKAGE_FILES := $(wildcard ros_ws/src/*/setup.py ros_ws/src/*/setup.cfg ros_ws/src/*/package.xml \
	ros_ws/src/sandbot_bringup/launch/*.py ros_ws/src/sandbot_bringup/config/*)

.PHONY: help setup demo faults fuzz soak test test-quick test-whole lint bench bench-quick screenshots notebook docs reference pasted rerun lock browser clean

help:
	@sed -n '1s/# //p' Makefile
	@awk '/^## / {says = substr($$0, 4)} /^[a-z-]+:/ && says {printf "  %-12s %s\n", $$1, says; says = ""}' Makefile

.venv/.ready: requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "trackway: Python 3.11 or newer is needed, this is " + sys.version.split()[0] + "; try make PYTHON=python3.11")'
	@echo "trackway: creating .venv from requirements.lock (about two minutes)"
	$(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r requirements.lock
	@touch $@

ros_ws/install/.ready: .venv/.ready $(PACKAGE_FILES) tools/install_ros2_fallback.py
	@echo "trackway: building the workspace"
	@rm -rf ros_ws/build ros_ws/install ros_ws/log
	source .venv/bin/activate && cd ros_ws && colcon build --symlink-install --event-handlers console_direct- status- --executor sequential
	.venv/bin/python tools/install_ros2_fallback.py
	@touch $@

# Also after an update: a tracker that compiles in the middle of its first trial stands still, and the trial fails.
ros_ws/install/.compiled: ros_ws/install/.ready tools/warm_up.py $(shell grep -rl numba ros_ws/src --include=*.py)
	@echo "trackway: compiling"
	$(RUN) python -m compileall -q ros_ws/src
	$(RUN) python tools/warm_up.py >/dev/null 2>&1 || { $(RUN) python tools/warm_up.py; exit 1; }
	@touch $@

## What every other target needs: the wheels, the workspace, compiled kernels.
setup: ros_ws/install/.compiled

## A blind campaign on the virtual lab, from trials to verdict, in DEMO_OUT; SEED hides one more effect.
demo: setup
	$(RUN) bash tools/demo.sh "$(DEMO_OUT)" "$(SEED)"

# Three workers more than there are CPUs: what runs nodes over DDS or a browser mostly waits.
# A worker that died is not replaced: xdist would give the new one the same test, again and again.
# Also where bytecode is not written by default: each worker would read and rewrite every changed test anew.
PYTEST := PYTHONDONTWRITEBYTECODE= python -m pytest --dist loadfile --no-loadscope-reorder --max-worker-restart 0
WORKERS ?= $(shell echo $$(($$(nproc) + 3)))

LINT := ruff check . && ruff format --check . && mypy && lint-imports

# Tests compiled once, not by each worker that reads them.
.venv/.tests: ros_ws/install/.ready
	$(RUN) PYTHONDONTWRITEBYTECODE= python -m pytest --collect-only -q > /dev/null || true
	@touch $@

# Lint runs beside them, on a CPU that would wait until the tests are compiled.
## Lint, and all tests but the whole matrices.
test: setup browser
	@$(RUN) { $(LINT); } & lint=$$!; \
	$(MAKE) --no-print-directory .venv/.tests; \
	$(RUN) $(PYTEST) -n $(WORKERS) -m "not whole" $(PYTEST_ARGS); tests=$$?; \
	wait $$lint || { echo "trackway: lint has failed, see above; make lint shows it alone" >&2; exit 1; }; \
	exit $$tests

## The tests that need neither ROS, nor a browser, nor much time.
test-quick: setup
	$(RUN) $(PYTEST) -n 2 -m "not slow and not ros and not browser and not whole" $(PYTEST_ARGS)

## The matrices of which `make test` takes a sample.
test-whole: setup
	$(RUN) $(PYTEST) -n 2 -m whole $(PYTEST_ARGS)

## Every process of a live trial killed, frozen and ended at every moment; FAULTS narrows it down, as in --targets clock.
faults: setup
	$(RUN) python tests/faults/matrix.py $(FAULTS)

## Spoilt files for every parser, FUZZ cases more than there were; counts in benchmarks/fuzz.md.
FUZZ ?= 10000
fuzz: setup
	$(RUN) python tests/faults/fuzz.py --cases $(FUZZ)

## Live trials back to back for SOAK minutes: what grows, drifts or is lost, in benchmarks/soak.md.
SOAK ?= 30
soak: setup
	$(RUN) python tests/faults/soak.py --minutes $(SOAK)

## ruff, mypy and the contracts between packages.
lint: setup
	$(RUN) $(LINT)

## The benchmarks, or ONLY one of them; reports in benchmarks/.
bench: setup
	$(RUN) python benchmarks/run.py $(ONLY)

## Ratios to peers again, against those of the last `make bench`: fails where one lost a fifth.
bench-quick: setup
	$(RUN) python benchmarks/run.py --quick

## The pictures of docs/explorer.md and docs/console.md, drawn anew.
screenshots: setup browser
	$(RUN) python tools/screenshots.py
	$(RUN) python tools/console_picture.py

## docs/python.md run, its outputs written back, and examples/python.ipynb made of it.
notebook: setup
	$(RUN) python tools/notebook.py

## docs/lookup written anew from the code.
reference: setup
	$(RUN) python tools/reference.py

## Every command of README and docs typed into a fresh shell: docs/lookup/pasted.md holds their exit codes. Five minutes.
pasted: setup
	$(RUN) python tools/pasted.py

## docs/ as a site in runs/site, strict about links. Its wheels are fetched for it alone: nothing else needs them.
docs: reference
	$(RUN) python -m pip install --quiet --disable-pip-version-check --no-deps -r requirements-docs.lock
	$(RUN) NO_MKDOCS_2_WARNING=1 mkdocs build --strict --quiet && echo "runs/site/index.html"

## Rerun's wheels, an extra of 240 MB that only `export --out TRIAL.rrd` needs.
rerun: setup
	$(RUN) python -m pip install --quiet --disable-pip-version-check --no-deps -r requirements-rerun.lock

## Chromium for the browser tests comes from the distribution; nothing to do where it is there already.
browser:
	@command -v chromium >/dev/null && command -v chromedriver >/dev/null || \
		{ echo "trackway: installing chromium for the browser tests"; \
		  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq chromium chromium-driver >/dev/null; }

## Re-pin every wheel from requirements.in.
lock:
	$(PYTHON) tools/lock.py

## Remove .venv, the built workspace and runs/.
clean:
	rm -rf .venv ros_ws/build ros_ws/install ros_ws/log runs
