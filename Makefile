# Everything from a fresh clone with python3 (3.11 or newer) and make: `make report`, `make test`.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: report report-full test regress sweep lint api clean

.venv/.ready: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed, this is %d.%d" % sys.version_info[:2])'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@

.venv/.peers: .venv/.ready
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[peers]'
	touch $@

LOCAL := reports/local
report: .venv/.ready  ## short runs, the first page first; what takes longer as committed: into reports/local/
	rm -rf $(LOCAL)
	$(BIN)/python -m bench fresnel weights costs trajectory kernels --output $(LOCAL)/data
	$(BIN)/python -m reports.build --output $(LOCAL)
	$(BIN)/python -m bench --missing --output $(LOCAL)/data
	$(BIN)/python -m reports.build --output $(LOCAL)

report-full: .venv/.ready .venv/.peers  ## everything, with longer runs and the peers: what is committed in reports/
	$(BIN)/python -m bench --full
	$(BIN)/python -m reports.build

test: .venv/.ready  ## on all cores
	$(BIN)/python -m pytest -n auto

regress: .venv/.ready  ## against analytic solutions alone
	$(BIN)/python -m pytest -n auto -m analytic tests

sweep: .venv/.ready  ## random inputs, fifty times as many as in `make test`
	$(BIN)/python -m pytest -n auto -m sweep --hypothesis-profile=sweep tests

lint: .venv/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

api: .venv/.ready  ## pages of every public docstring in reports/api/, of the modules that tests/test_docstrings.py holds to account
	PYTHONPATH=.:tests $(BIN)/pdoc --docformat numpy --no-show-source -o reports/api \
		$$(PYTHONPATH=.:tests $(BIN)/python -c 'from test_docstrings import MODULES; print(*MODULES)')

clean:
	rm -rf .venv build reports/api *.egg-info .pytest_cache .mypy_cache .ruff_cache
