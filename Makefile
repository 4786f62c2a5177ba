# SPDX-License-Identifier: Apache-2.0
# make demo   sets up and runs the demonstration     make test   sets up and runs the tests
# make fuzz   odd arrays and degenerate contours, leaks, damaged files, odd messages, interruptions, long runs: SECONDS=600 SEED=1
# make sanitize   kernels that end the process where they read or write beyond an array, and their tests
# make site   builds the docs as site/index.html, in an environment of its own; a link that leads nowhere is an error
# Where there is no C++ compiler, that of the package ziglang is taken. PYTHON=python3.12 chooses another interpreter.

PYTHON ?= python3
SECONDS := 600
SEED := 1
VENV := .venv
BIN := $(VENV)/bin
# Of an extra; what pip would install with it, without building the package again.
requirements = $(BIN)/python -c 'import importlib.metadata as m; \
	  print("\n".join(r.split(";")[0] for r in m.requires("grasptrack") if r.rstrip("\"\x27").endswith(("\"$(1)", "\x27$(1)"))))'
NATIVE := CMakeLists.txt $(wildcard native/* native/*/*)
SOURCES := $(shell find src bench examples -name "*.py")

# After pip: which of them it was, and what would do the same by hand.
failed = { echo "make: pip could not do it; its lines above say why. Then: make again, or $(BIN)/python -m pip install $(1)" >&2; \
	  echo "without a network: PIP_NO_INDEX=1 PIP_FIND_LINKS=folder-of-wheels make ..." >&2; exit 2; }

# A compiler where there is none, with the archiver that CMake looks for beside it. -I: pip hides packages from what builds another.
ZIG := $(VENV)/zig
zig_tool = printf '\043!/bin/sh\nexec "$$(dirname "$$0")/../bin/python" -I -m ziglang $(1) "$$@"\n' > $(ZIG)/$(1); chmod +x $(ZIG)/$(1)
find_compiler = if test -z "$$CXX" && ! command -v c++ > /dev/null && ! command -v g++ > /dev/null && ! command -v clang++ > /dev/null; then \
	  echo "There is no C++ compiler here: that of the package ziglang (100 MB) compiles the kernels."; \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check ziglang || $(call failed,ziglang); \
	  mkdir -p $(ZIG); $(call zig_tool,c++); $(call zig_tool,ar); $(call zig_tool,ranlib); \
	  export CXX="$(abspath $(ZIG))/c++"; \
	fi

.PHONY: demo announce test fuzz sanitize site clean

demo: announce $(VENV)/.package
	@$(BIN)/grasptrack demo

announce:
	@test -e $(VENV)/.package || echo "Sets up $(VENV) first: downloads some 150 MB of packages and compiles the kernels; a minute on two idle cores."

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not slow"

fuzz: $(VENV)/.dev
	$(BIN)/python -W ignore tests/fuzz/run.py --seconds $(SECONDS) --seed $(SEED)
	$(BIN)/python -W ignore tests/fuzz/leaks.py --seed $(SEED)
	$(BIN)/python -W ignore tests/fuzz/damaged_files.py --seconds $(SECONDS) --seed $(SEED)
	$(BIN)/python -W ignore tests/fuzz/live_messages.py --seconds $(SECONDS) --seed $(SEED) --connections 10000
	$(BIN)/python tests/fuzz/interruptions.py --seconds $(SECONDS) --seed $(SEED)
	$(BIN)/python -W ignore tests/fuzz/long_run.py --seed $(SEED)
	$(BIN)/python -W ignore tests/fuzz/servo_calls.py --seed $(SEED)
	$(BIN)/python -W ignore tests/fuzz/long_live.py --seconds $(SECONDS) --seed $(SEED)

sanitize: $(VENV)/.dev
	$(BIN)/python tests/fuzz/sanitize.py

# Run anew where a notebook or the package has changed: some half a minute for all.
build/notebooks/%.ipynb: examples/notebooks/%.ipynb $(SOURCES) | $(VENV)/.dev
	@mkdir -p $(@D)
	$(BIN)/jupyter execute $< --output=$(abspath $@)

site: $(VENV)/.docs $(patsubst examples/%,build/%,$(wildcard examples/notebooks/*.ipynb))
	NO_MKDOCS_2_WARNING=1 $(VENV)/docs/bin/mkdocs build --strict
	@echo "site/index.html"

$(VENV)/.venv:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	  { echo "grasptrack needs Python 3.10 or newer as $(PYTHON): name one with PYTHON=..." >&2; exit 2; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "$(PYTHON) has no venv or ensurepip: install it (Debian, Ubuntu: apt install python3-venv)" >&2; exit 2; }
	@$(PYTHON) -m venv $(VENV)
	@touch $@

# Editable: a change of a .py file needs no setup, one of a kernel is compiled anew.
$(VENV)/.package: $(VENV)/.venv pyproject.toml $(NATIVE)
	@$(find_compiler); \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable . || $(call failed,--editable .)
	@touch $@

$(VENV)/.dev: $(VENV)/.package bench/pyproject.toml
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ./bench || $(call failed,--editable ./bench)
	$(call requirements,dev) \
	  > $(VENV)/dev.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement $(VENV)/dev.txt || \
	  $(call failed,--requirement $(VENV)/dev.txt)
	@touch $@

# An environment of its own: the package is read, not imported.
$(VENV)/.docs: $(VENV)/.package
	$(PYTHON) -m venv $(VENV)/docs
	$(call requirements,docs) > $(VENV)/docs.txt
	$(VENV)/docs/bin/python -m pip install --quiet --disable-pip-version-check --requirement $(VENV)/docs.txt
	@touch $@

clean:
	rm -rf $(VENV) build dist site
