# Every target sets up what it needs: a virtual environment with the pinned versions of constraints-ci.txt.

PYTHON ?= python3
VENV ?= .venv
RUNS ?= runs
AGENTS ?= ppo,icm,eco,gt-grid,sprl,gt-sprl,random
WORKERS ?= $(shell nproc)
NAVIX_BASE ?= python3.12

BIN := $(VENV)/bin
READY := $(VENV)/.ready
BENCH_READY := $(VENV)/.bench-ready
NAVIX_READY := $(VENV)-navix/.ready
PIP := PIP_CONSTRAINT=constraints-ci.txt PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install -q

.PHONY: run test test-long test-upstream known-answers frameworks lint types docs bench setup clean

setup: $(READY)

$(READY): pyproject.toml constraints.txt constraints-ci.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(None if (3, 11) <= v <= (3, 13) else f"Python {v[0]}.{v[1]}: sprl-bench needs 3.11 to 3.13; name one with make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	@echo "Installing into $(VENV); the first time takes a few minutes."
	$(PIP) torch==2.13.0
	$(PIP) -e '.[dev]'
	@touch $@

run: setup ## Train the reference agents on the smoke suite and print the table.
	$(BIN)/sprl-bench run --suite smoke --agents $(AGENTS) --seeds 1 --out $(RUNS) --workers $(WORKERS)

test: setup ## All tests but the long versions of some.
	OMP_NUM_THREADS=1 SDL_VIDEODRIVER=dummy $(BIN)/python -m pytest -n $(WORKERS) -m 'not slow'

test-long: setup ## The long versions of the differential tests too.
	OMP_NUM_THREADS=1 SDL_VIDEODRIVER=dummy $(BIN)/python -m pytest -n $(WORKERS)

test-upstream: ## The Fetch environments beside untouched Gymnasium-Robotics, on the last MuJoCo that it works with.
	$(PYTHON) -m venv $(VENV)-upstream
	grep -hv -e '^mujoco==' -e '^-c' constraints.txt constraints-ci.txt > $(VENV)-upstream/constraints.txt
	PIP_CONSTRAINT=$(VENV)-upstream/constraints.txt $(VENV)-upstream/bin/python -m pip install -q -e '.[fetch]' \
		'mujoco==3.11.*' pytest hypothesis
	$(VENV)-upstream/bin/python -m pytest tests/envs/fetch/test_upstream.py

KNOWN := random ppo icm eco gt-grid sprl gt-sprl rnd count

known-answers: setup ## Each agent learns as its published band says; two minutes an agent.
	for agent in $(KNOWN); do OMP_NUM_THREADS=1 $(BIN)/sprl-bench check-agent $$agent || exit 1; done

# Each framework is installed by the line of its page, into a virtual environment of its own.
FRAMEWORKS := minari rllib skrl tianshou torchrl
GYMNASIUMS := 1.2.3 1.3.0

frameworks: setup ## The scripts of docs/frameworks, installed as their pages say, and older versions of Gymnasium.
	SPRL_FRAMEWORK=here OMP_NUM_THREADS=1 $(BIN)/python -m pytest tests/frameworks
	for name in $(FRAMEWORKS); do \
		folder=$(VENV)-frameworks/$$name && $(PYTHON) -m venv $$folder && (. $$folder/bin/activate && \
		export PIP_QUIET=1 PIP_DISABLE_PIP_VERSION_CHECK=1 OMP_NUM_THREADS=1 SPRL_FRAMEWORK=$$name && \
		pip install -c constraints-ci.txt pytest hypothesis && \
		eval "$$(sed -n 's/^Install it: `\(pip install .*\)`\.$$/\1/p' docs/frameworks/$$name.md)" && \
		python -m pytest tests/frameworks) || exit 1; \
	done
	for version in $(GYMNASIUMS); do \
		$(BIN)/python -m pip install -q --no-deps --target $(VENV)-frameworks/gymnasium-$$version gymnasium==$$version && \
		PYTHONPATH=$(VENV)-frameworks/gymnasium-$$version OMP_NUM_THREADS=1 SDL_VIDEODRIVER=dummy \
			$(BIN)/python -m pytest -n $(WORKERS) -m 'not slow' tests/envs tests/recorder || exit 1; \
	done

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	$(BIN)/mypy

docs: setup ## The site, into build/site; a warning is an error.
	$(BIN)/python docs/site/build.py build/site

bench: $(BENCH_READY) $(NAVIX_READY) ## Speed as ratios, measured side by side; leave the machine alone meanwhile.
	$(BIN)/python -m benchmarks

$(BENCH_READY): $(READY)
	$(PIP) -e '.[bench]'
	@touch $@

# NAVIX needs Python 3.12 and another JAX than SBX, so it has an environment of its own where that interpreter runs.
$(NAVIX_READY):
	@if $(NAVIX_BASE) -c '' 2>/dev/null; then \
		$(NAVIX_BASE) -m venv $(VENV)-navix && \
		$(VENV)-navix/bin/python -m pip install -q navix==4.0.0 jax==0.12.0.1 jaxlib==0.12.0.1 flax==0.12.12 && \
		touch $@; \
	else echo "$(NAVIX_BASE) does not run here: NAVIX is not measured. Name one with make bench NAVIX_BASE=..."; fi

clean:
	rm -rf $(VENV) $(VENV)-frameworks $(VENV)-navix $(VENV)-upstream build dist .mypy_cache .pytest_cache .ruff_cache
