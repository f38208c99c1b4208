# The one place of commands. `make help` lists them.
SHELL := /bin/sh
JOBS ?= $(shell nproc)
SCENARIO ?= msgs/scenarios/climb-makers.yaml
OBJECTIVE ?= balanced
OUT ?= out
ARCHITECTURES ?= amd64 arm64

BIN := .venv/bin
SHELL_FILES = '*'
CPP_FILES = '*.c' '*.h' '*.cpp' '*.hpp'
TIDY_FILES = 'msgs/*.c' 'planner/native/*.cpp' 'runtime/*.cpp' 'tools/sim/*.cpp' 'firmware/core/*.c' 'firmware/safety/*.c' 'firmware/service/*.c' 'firmware/update/*.c' 'tools/sim/boards/*.c' 'firmware/ports/host/*.c'

.PHONY: help setup setup-programs setup-packages extras configure-programs configure-development configure-sanitized build programs packages try-machines can-kernel climb test test-native test-sanitized test-python test-sweeps lint format docs sbom benchmarks bench firmware fuzz lock clean anew

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 18

setup: ## install what is missing: system packages, .venv, the command .venv/bin/crux
	@tools/setup/setup

setup-programs: ## the same without what development alone needs
	@tools/setup/setup programs

extras: setup-programs ## install what campaigns and tables of logs need besides: Dask, pyarrow, psutil
	@tools/setup/setup extras

# What is built is decided here: without these options, the programs alone.
checked = -DCRUX_TESTS=ON -DCRUX_CCACHE=ON -DCMAKE_COMPILE_WARNING_AS_ERROR=ON

configure-programs: setup-programs
	@tools/setup/configure build/cmake

configure-development: setup
	@tools/setup/configure build/cmake $(checked) -DCRUX_FIRMWARE=ON -DCRUX_EMULATED=ON

configure-sanitized: setup
	@tools/setup/configure build/asan $(checked) -DCRUX_SANITIZE=ON -DCMAKE_BUILD_TYPE=Debug

compile = cmake --build build/cmake -j $(JOBS) --target $(1) \
  && $(BIN)/python -m compileall -q msgs/python planner tools build/gen/python firmware/ports

build: configure-development ## generate and compile everything
	@$(call compile,all)

programs: configure-programs ## generate and compile what the command crux starts, in a third of the time
	@$(call compile,crux_programs)

setup-packages:
	@tools/setup/setup packages

packages: setup-packages configure-programs ## build/packages: the wheel, and packages for Debian 12 and 13, amd64 and arm64
	@$(call compile,crux_programs)
	@packaging/packages $(ARCHITECTURES)

try-machines: ## run `make climb` on Debian 12 and 13 and Ubuntu, bare and half-equipped, in chroots; needs root and mmdebstrap
	python3 packaging/try_machines.py --jobs $(JOBS)

can-kernel: setup ## the kernel with CAN that tests run in; built when it is missing from ~/.cache/crux
	@$(BIN)/crux can kernel

climb: programs ## plan SCENARIO and climb it in the simulated world; plan, log and report go to OUT
	@mkdir -p '$(OUT)'
	$(BIN)/crux plan '$(SCENARIO)' --objective '$(OBJECTIVE)' -o '$(OUT)/plan.mcap'
	$(BIN)/crux climb '$(OUT)/plan.mcap' -o '$(OUT)/telemetry.mcap' --report '$(OUT)/report.html'

test: test-native test-python ## every test but sanitizers and long sweeps

test-native: build
	ctest --test-dir build/cmake -j $(JOBS) --output-on-failure --no-tests=error

test-sanitized: configure-sanitized ## the C and C++ tests under AddressSanitizer and UndefinedBehaviorSanitizer
	@cmake --build build/asan -j $(JOBS) --target crux_native_tests
	ctest --test-dir build/asan -j $(JOBS) --output-on-failure --no-tests=error

# Compiled tests are kept, whatever the environment says: collecting them takes twice as long without.
pytest = PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest
# Tests that go by the clock wait more than they compute: three of them leave each other most of the machine. Of the
# others one process more than there are cores, because many wait: for nodes, other processes, a browser.
shared_out = -n $$(($(JOBS) + 1)) --dist loadfile --no-loadscope-reorder

test-python: build can-kernel
	$(pytest) -m alone -n 3 --dist worksteal $(shell grep -rl --include='test_*.py' 'mark\.alone' tests)
	$(pytest) -m "not alone and not sweep" $(shared_out)

test-sweeps: build can-kernel setup-packages ## what tests show in more cases, or for longer, than `make test` has time for
	$(pytest) -m sweep $(shared_out) $(shell grep -rl --include='test_*.py' 'mark\.sweep' tests)

# files(PATTERN, GIT-GREP-OPTIONS): a shell word list of the sources whose names match, with or without a repository;
# ends the recipe where there are none.
files = files=$$(git grep --no-index --exclude-standard $(2) -- $(1)) \
  || { echo "make $@: found no files $(1) below $$PWD" >&2; exit 1; }

lint: build ## ruff, mypy, shellcheck, clang-format, clang-tidy (files that passed before are known by content)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	@$(call files,$(SHELL_FILES),-lE '^#!/bin/(ba)?sh$$'); shellcheck $$files
	@$(call files,$(CPP_FILES),-l ''); $(BIN)/clang-format --dry-run -Werror $$files
	@$(call files,$(TIDY_FILES),-l ''); $(BIN)/python tools/setup/tidy.py build/cmake $(JOBS) $$files

format: setup ## bring Python, C and C++ into the project's form
	$(BIN)/ruff check --fix-only -q
	$(BIN)/ruff format -q
	@$(call files,$(CPP_FILES),-l ''); $(BIN)/clang-format -i $$files

docs: programs ## the docs site: build/docs/index.html
	@tools/setup/docs_environment
	@rm -rf build/docs
	@$(BIN)/python docs/site/pages.py build/docs-source
	@PYTHONPATH=$$($(BIN)/python -c 'import sys; print(*sys.path[1:], sep=":")') \
	  .venv-docs/bin/python -m sphinx -q -W --keep-going -c docs/site -d build/docs-cache build/docs-source build/docs

sbom: setup ## the software bill of materials: build/crux.cdx.json
	@$(BIN)/python tools/setup/sbom.py build/crux.cdx.json

benchmarks: programs ## plan the scenes that ship, for the figures of docs/benchmarks.md that README.md quotes
	$(BIN)/python docs/site/benchmarks.py

bench: build ## reproduce the figures of merit
	$(BIN)/crux bench all

firmware: configure-development ## the node images and their sizes
	@cmake --build build/cmake -j $(JOBS) --target crux_firmware

fuzz: build configure-sanitized ## ten million frames and a million parameter writes against both nodes, ten million packets against the runtime, under sanitizers, and against its operators
	@cmake --build build/asan -j $(JOBS) --target shell_tests
	CRUX_FUZZ_PACKETS=10000000 build/asan/tests/runtime/shell/shell_tests --gtest_filter='GateFuzz.*:OperatorServerTest.Lives*'
	CRUX_FUZZ_PACKETS=10000000 $(BIN)/python -m pytest tests/tools/test_hostile_messages.py -m sweep
	CRUX_FUZZ_FRAMES=10000000 CRUX_FUZZ_WRITES=1000000 $(BIN)/python -m pytest tests/firmware/test_fuzz.py -m sweep -k unsafe

lock: setup ## resolve pyproject.toml anew
	@tools/setup/lock

clean: ## remove build and out; .venv stays
	rm -rf build out
