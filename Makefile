# The one place of commands. `make help` lists them.
SHELL := /bin/sh
JOBS ?= $(shell nproc)
SCENARIO ?= msgs/scenarios/climb-four-holds.yaml
OUT ?= out
ARCHITECTURES ?= amd64 arm64

BIN := .venv/bin
CPP_FILES = $(shell git ls-files '*.c' '*.h' '*.cpp' '*.hpp')
TIDY_FILES = $(shell git ls-files 'msgs/*.c' 'runtime/*.cpp' 'tools/sim/*.cpp' 'firmware/core/*.c' 'firmware/safety/*.c' 'firmware/service/*.c' 'firmware/update/*.c' 'firmware/ports/emulated/*.c' 'firmware/ports/host/*.c')

.PHONY: help setup setup-programs setup-packages build programs packages can-kernel climb test test-native test-sanitized test-python test-sweeps lint format docs sbom bench firmware fuzz lock clean anew

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 18

setup: ## install what is missing: system packages, .venv, the command .venv/bin/crux
	@tools/setup/setup

setup-programs: ## the same without what development alone needs
	@tools/setup/setup programs

# A build folder that came here with a copied or moved checkout would go on building the old place's sources.
here = $(shell [ "$$(sed -n 's/^CMAKE_HOME_DIRECTORY:INTERNAL=//p' $(1)/CMakeCache.txt 2>/dev/null)" -ef . ] && echo yes)

build/cmake/build.ninja: $(if $(call here,build/cmake),,anew)
build/asan/build.ninja: $(if $(call here,build/asan),,anew)
build/cmake/build.ninja build/asan/build.ninja: | setup-programs
	@$(if $(call here,$(@D)),,rm -rf $(@D))
	@mkdir -p $(@D)
	@cmake -S . -B $(@D) -G Ninja $(if $(findstring asan,$@),-DCRUX_SANITIZE=ON -DCMAKE_BUILD_TYPE=Debug) >$(@D).log 2>&1 \
	  || { cat $(@D).log; rm -f $@; exit 1; }

compile = cmake --build build/cmake -j $(JOBS) --target $(1) \
  && $(BIN)/python -m compileall -q msgs/python planner tools build/gen/python firmware/ports

build: setup build/cmake/build.ninja ## generate and compile everything
	@$(call compile,all)

programs: setup-programs build/cmake/build.ninja ## generate and compile all but the tests, in a third of the time
	@$(call compile,crux_programs)

setup-packages:
	@tools/setup/setup packages

packages: setup-packages build/cmake/build.ninja ## build/packages: the wheel, and packages for Debian 12 and 13, amd64 and arm64
	@$(call compile,crux_programs)
	@packaging/packages $(ARCHITECTURES)

can-kernel: setup ## the kernel with CAN that tests run in; built when it is missing from ~/.cache/crux
	@$(BIN)/crux can kernel

climb: programs ## plan SCENARIO and climb it in the simulated world; plan, log and report go to OUT
	@mkdir -p $(OUT)
	$(BIN)/crux plan $(SCENARIO) -o $(OUT)/plan.mcap
	$(BIN)/crux climb $(OUT)/plan.mcap -o $(OUT)/telemetry.mcap --report $(OUT)/report.html

test: test-native test-python ## every test but sanitizers and long sweeps

test-native: build
	ctest --test-dir build/cmake -j $(JOBS) --output-on-failure --no-tests=error

test-sanitized: setup build/asan/build.ninja ## the C and C++ tests under AddressSanitizer and UndefinedBehaviorSanitizer
	@cmake --build build/asan -j $(JOBS) --target crux_native_tests
	ctest --test-dir build/asan -j $(JOBS) --output-on-failure --no-tests=error

shared_out = -n $(JOBS) --dist loadfile --no-loadscope-reorder

test-python: build can-kernel
	$(BIN)/python -m pytest -m alone $(shell grep -rl --include='test_*.py' 'mark\.alone' tests)
	$(BIN)/python -m pytest -m "not alone and not sweep" $(shared_out)

test-sweeps: build can-kernel setup-packages ## what tests show in more cases, or for longer, than `make test` has time for
	$(BIN)/python -m pytest -m sweep $(shared_out) $(shell grep -rl --include='test_*.py' 'mark\.sweep' tests)

lint: build ## ruff, mypy, clang-format, clang-tidy (files that passed before are known by content)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run -Werror $(CPP_FILES)
	$(BIN)/python tools/setup/tidy.py build/cmake $(JOBS) $(TIDY_FILES)

format: setup ## bring Python, C and C++ into the project's form
	$(BIN)/ruff check --fix-only -q
	$(BIN)/ruff format -q
	$(BIN)/clang-format -i $(CPP_FILES)

docs: programs ## the docs site: build/docs/index.html
	@tools/setup/docs_environment
	@rm -rf build/docs
	@$(BIN)/python docs/site/pages.py build/docs-source
	@PYTHONPATH=$$($(BIN)/python -c 'import sys; print(*sys.path[1:], sep=":")') \
	  .venv-docs/bin/python -m sphinx -q -W --keep-going -c docs/site -d build/docs-cache build/docs-source build/docs

sbom: setup ## the software bill of materials: build/crux.cdx.json
	@$(BIN)/python tools/setup/sbom.py build/crux.cdx.json

bench: build ## reproduce the figures of merit
	$(BIN)/crux bench all

firmware: setup build/cmake/build.ninja ## the node images and their sizes
	@cmake --build build/cmake -j $(JOBS) --target crux_firmware

fuzz: build build/asan/build.ninja ## ten million frames and a million parameter writes against both nodes, ten million packets against the runtime, under sanitizers
	@cmake --build build/asan -j $(JOBS) --target shell_tests
	CRUX_FUZZ_PACKETS=10000000 build/asan/tests/runtime/shell/shell_tests --gtest_filter='GateFuzz.*'
	CRUX_FUZZ_FRAMES=10000000 CRUX_FUZZ_WRITES=1000000 $(BIN)/python -m pytest tests/firmware/test_fuzz.py -m sweep -k unsafe

lock: setup ## resolve pyproject.toml anew
	@tools/setup/lock

clean: ## remove build and out; .venv stays
	rm -rf build out
