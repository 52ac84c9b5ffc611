# Everything from a fresh clone with Python 3.11 or newer and make: `make report`, `make test`; another interpreter: `make test PYTHON=python3.13`.
PYTHON ?= python3
BIN := .venv/bin
VERSION := $(shell $(PYTHON) -c 'import platform; print(platform.python_version())' 2>/dev/null)
READY := .venv/.ready-$(VERSION)
DEV := .venv/.dev-$(VERSION)
# --no-compile: what is imported is compiled then; all of it would take two thirds of the installation
# a container may forbid bytecode; without it every process compiles the sources of all that it imports, which takes five seconds
export PYTHONDONTWRITEBYTECODE :=
PIP := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint requirements.lock

.PHONY: report report-full test test-latest regress sweep lint lock api clean

define VENV
$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed, this is %d.%d" % sys.version_info[:2])'
@echo "installing into .venv, with the versions of requirements.lock, for Python $(VERSION)"
$(PYTHON) -m venv --clear .venv
endef

$(READY): requirements.lock pyproject.toml
	$(VENV)
	$(PIP) setuptools
	$(PIP) --no-build-isolation -e .
	touch $@

# the lock names all that the tests need: nothing is left to be resolved
$(DEV): $(wildcard $(READY)) requirements.lock pyproject.toml
	$(if $(wildcard $(READY)),@echo "installing what the tests need",$(VENV))
	$(PIP) --no-deps -r requirements.lock
	$(PIP) --no-deps --no-build-isolation -e .
	touch $(if $(wildcard $(READY)),,$(READY)) $@

.venv/.peers: $(READY)
	-$(PIP) --no-build-isolation -e '.[peers]'
	touch $@

LOCAL := reports/local
report: $(READY)  ## short runs, the first page first; what takes longer as committed: into reports/local/
	rm -rf $(LOCAL)
	$(BIN)/python -m bench fresnel weights costs trajectory kernels --output $(LOCAL)/data
	$(BIN)/python -m reports.build --output $(LOCAL)
	$(BIN)/python -m bench --stale --output $(LOCAL)/data
	$(BIN)/python -m reports.build --output $(LOCAL)

report-full: $(READY) .venv/.peers  ## longer runs and the peers, of what is older than the code: what is committed in reports/
	$(BIN)/python -m bench --full --stale
	$(BIN)/python -m reports.build

test: $(DEV)  ## on all cores, a module's tests on one of them unless another one is idle
	$(BIN)/python -m pytest -n auto --dist worksteal

test-latest:  ## the same with the newest of every dependency instead of the locked ones
	$(PYTHON) -m venv --clear .venv-latest
	.venv-latest/bin/python -m pip install --quiet --disable-pip-version-check --upgrade -e '.[dev]'
	.venv-latest/bin/python -m pytest -n auto --dist worksteal

regress: $(DEV)  ## against analytic solutions alone
	$(BIN)/python -m pytest -n auto -m analytic tests

sweep: $(DEV)  ## random inputs, fifty times as many as in `make test`
	$(BIN)/python -m pytest -n auto -m sweep --hypothesis-profile=sweep tests

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/lint-imports

lock: $(READY)  ## the newest of every dependency, for all Python versions from 3.11 on, into requirements.lock
	$(PIP) uv
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --extra dev --no-annotate --custom-compile-command 'make lock' pyproject.toml -o requirements.lock

api: $(DEV)  ## pages of every public docstring in reports/api/, of the modules that tests/test_docstrings.py holds to account
	PYTHONPATH=.:tests $(BIN)/pdoc --docformat numpy --no-show-source -o reports/api \
		$$(PYTHONPATH=.:tests $(BIN)/python -c 'from test_docstrings import MODULES; print(*MODULES)')

clean:
	rm -rf .venv .venv-latest build reports/api $(LOCAL) *.egg-info .pytest_cache .mypy_cache .ruff_cache
