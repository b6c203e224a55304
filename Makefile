# Everything from a bare Python >= 3.11: `make run`, `make test`. `make help` lists the rest.

PYTHON ?= python3
ARGS ?=
BIN := .venv/bin
READY := .venv/.ready
PYTEST := $(BIN)/python -m pytest
COMPILE := $(BIN)/python -m tools.compile_model
MDF := .venv/mdf
DOCS := .venv/docs

# Tests, benchmarks and diagnoses use the cores themselves: threads of the algebra library would be in their way.
export OPENBLAS_NUM_THREADS ?= 1
# Hundreds of processes are started by tests: without kept bytecode each compiles the whole project anew.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

.PHONY: help
help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-19s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.PHONY: run
run: $(READY)  ## run AW0 and AW3 on the virtual rig, in real time over real sockets
	$(BIN)/astb run aw0 aw3 --rig local --out runs/demo

.PHONY: test
test: $(READY)  ## the ordinary suite (ARGS="-k leak" narrows it)
	@tools/test.sh $(BIN)/python "not slow" $(ARGS)

.PHONY: test-slow
test-slow: $(READY)  ## only the tests that the ordinary suite leaves out for their length
	@tools/test.sh $(BIN)/python "slow and not vcan and not wheel" $(ARGS)

.PHONY: test-studies
test-studies: $(READY)  ## all tests of the studies: the paper, benchmarks, mutations, gallery
	@tools/test.sh $(BIN)/python "not vcan" studies/tests $(ARGS)

.PHONY: test-all
test-all: $(READY)  ## the ordinary suite and the slow tests
	$(PYTEST) $(ARGS)

.PHONY: test-wheel
test-wheel: $(READY)  ## build sdist and wheel, install the wheel where no checkout is, and use it there
	$(PYTEST) -m wheel tests/wheel $(ARGS)

.PHONY: test-mdf
test-mdf: $(MDF)/.ready  ## the tests of MDF files, with asammdf beside the environment
	PYTHONPATH=$$(echo $(CURDIR)/$(MDF)/lib/*/site-packages) $(PYTEST) -m mdf \
		$$(grep -rl --include='*.py' 'mark.mdf' tests) $(ARGS)

.PHONY: test-vcan
test-vcan: $(READY)  ## the SocketCAN tests, on this kernel's vcan or in user-mode Linux
# A changed model is compiled here, where no test waits for its rig meanwhile.
	@$(COMPILE)
	@$(BIN)/python -c 'from tests.foreign.can_rig import CanRig; CanRig().cycle()'
# In user-mode Linux all of this has one processor: where its host stalls, a rig rightly holds, and a test fails for it.
# Only where such tests are: system calls are slow there, and so is collecting five thousand others.
	tools/with_vcan.sh -t 1500 -- $(PYTEST) -m vcan --reruns 3 --reruns-delay 2 -rR \
		$$(grep -rl --include='*.py' 'mark.vcan' tests | xargs -n 1 dirname | sort -u) $(ARGS)

.PHONY: check
check: $(READY)  ## lint, spelling, format, types, import contracts, generated files
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/python -m tools.generate --check

.PHONY: format
format: $(READY)  ## let ruff put the code in order
	$(BIN)/ruff check --fix --exit-zero --quiet .
	$(BIN)/ruff format .
	$(BIN)/ruff check .

.PHONY: generate
generate: $(READY)  ## write the files that come from the table of signals and of states
	$(BIN)/python -m tools.generate

.PHONY: docs
docs: $(DOCS)/.ready  ## build the documentation as a site with search: build/site/docs/index.html
	@rm -rf build/site build/site-source && mkdir -p build/site-source
	@ln -s $(addprefix ../../,$(filter-out build runs %.egg-info,$(wildcard *))) build/site-source/
	@NO_MKDOCS_2_WARNING=1 PYTHONPATH=$$(echo $(CURDIR)/$(DOCS)/lib/*/site-packages) $(BIN)/python -m mkdocs build --quiet --strict
	@echo "open build/site/docs/index.html"

.PHONY: notebook
notebook: $(READY)  ## run the notebook of the tutorials and keep what came out
	$(BIN)/python -m tools.notebook

.PHONY: gallery
gallery: $(READY)  ## make the pictures of the gallery anew, and its page (ARGS=rig: one of them)
	$(BIN)/python -m astb_studies.gallery $(ARGS)

.PHONY: bench
bench: $(READY)  ## measure speed and lateness, each beside a control of the same minute
	$(BIN)/python -m astb_studies.benchmarks $(ARGS)

.PHONY: fuzz
fuzz: $(READY)  ## two million changed inputs for every decoder and every port (ARGS="modbus can-port --count 100000")
	$(BIN)/python -m tests.fuzz $(ARGS)

.PHONY: soak
soak: $(READY)  ## a rig at full rate for half an hour, with faults on and off (ARGS="--minutes 5")
	$(BIN)/python -m astb_studies.benchmarks.soak $(ARGS)

.PHONY: benchmark-diagnosis
benchmark-diagnosis: $(READY)  ## hide, diagnose and judge many times (ARGS="--cases 100"); resumes where it stopped
	$(BIN)/python -m astb_studies.benchmarks.diagnosis $(ARGS)

.PHONY: benchmark-investigations
benchmark-investigations: $(READY)  ## investigate sealed rigs (ARGS="--count 50"); resumes where it stopped
	$(BIN)/python -m astb_studies.benchmarks.diagnosis.investigations $(ARGS)

.PHONY: clean
clean:  ## remove the environment, caches and demo runs
	rm -rf .venv build dist *.egg-info runs .pytest_cache .mypy_cache .ruff_cache .hypothesis \
		.import_linter_cache .grimp_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamp is newer than pyproject.toml only after a complete installation.
$(READY): pyproject.toml studies/pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "ASTB needs Python 3.11 or newer and $(PYTHON) is $$($(PYTHON) -V 2>&1): try make PYTHON=python3.11" >&2; exit 2; }
	@echo "installing ASTB and its tools into .venv (once, about a minute)"
	@$(PYTHON) -m venv .venv || \
		{ echo "$(PYTHON) cannot make environments: on Debian and Ubuntu, apt-get install python3-venv" >&2; exit 2; }
# Bytecode of all packages takes half as long again as the packages; the first import of a module makes its own.
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input --no-compile --editable '.[dev]' --editable ./studies
	@echo "compiling the model (again after each change of it, about a minute)"
	@$(COMPILE)
	@touch $@

# Not into the environment itself: python-can imports asammdf wherever it finds it, a second of every process.
$(MDF)/.ready: $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input --no-compile --prefix $(MDF) \
		$$($(BIN)/python -c 'from bench_protocol.extras import requirements; print(*requirements("mdf"))')
	@touch $@

# Not into the environment itself either: the tests need none of these packages.
$(DOCS)/.ready: $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input --no-compile --prefix $(DOCS) \
		$$($(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"])')
	@touch $@
