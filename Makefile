# Everything that a clone needs is made here, in .venv; nothing outside the clone is touched, except
# that `make test` installs Debian's browser where it is missing and the user is root.
# All paths are relative, so that the clone may lie below a path with a space in it.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
PYTEST := $(PY) -m pytest -n 2 --dist worksteal
# Compiled modules are cached: processes and test workers start in half the time.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test slow test-rest test-all browser check bench docs screenshots measure coverage clean

WORLD ?= hospital

demo: $(VENV)/demo-ready
	$(PY) -m kant_sql.cli.main demo $(WORLD)

# What anybody runs: CONTRIBUTING.md says which tests these are.
test: check browser
	$(PYTEST) --most

# Finds what takes too long for `make test`, on a machine with nothing else to do.
slow: $(VENV)/test-ready browser
	$(PYTEST) --most --note-slow

# Where other PostgreSQL servers are: those of Debian, or POSTGRESQL="/opt/pg14/bin /opt/pg17/bin".
POSTGRESQL ?= $(wildcard /usr/lib/postgresql/*/bin)

# The other tests, and what depends on the server's version on each of these.
test-rest: $(VENV)/test-ready browser
	$(PYTEST) --rest
	@[ -n "$(POSTGRESQL)" ] || echo "no other PostgreSQL is installed, so none is tested:" \
	  'apt-get install postgresql, or POSTGRESQL="FOLDER_OF_PROGRAMS ..."'
	@set -e; for programs in $(POSTGRESQL); do \
	  echo "PostgreSQL of $$programs"; \
	  KANT_SQL_TEST_POSTGRESQL="$$programs" $(PYTEST) \
	    tests/contract tests/verify tests/audit tests/migrations --most --on-server; \
	done

test-all: test test-rest

# Where this cannot be done, the tests in a browser skip.
browser:
	@if [ -z "$$KANT_SQL_TEST_BROWSER" ] && ! command -v chromium >/dev/null \
	  && [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  export DEBIAN_FRONTEND=noninteractive; \
	  install="apt-get install -qq -y --no-install-recommends chromium"; \
	  echo "installing chromium for the tests in a browser"; \
	  $$install >/dev/null 2>&1 || { apt-get update -qq && $$install; } >/dev/null 2>&1 \
	  || echo "chromium cannot be installed: the tests in a browser will skip"; \
	fi

check: $(VENV)/test-ready
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -c "from importlinter.cli import lint_imports_command; lint_imports_command(['--no-cache'])"

bench: $(VENV)/test-ready
	$(PY) tests/benchmarks/run.py

# The site of docs/ with the API reference, in build/site; a warning is an error.
docs: $(VENV)/test-ready
	$(PY) -m mkdocs build --strict

# The pictures of the docs, by the same script as a test of it; needs chromium.
screenshots: $(VENV)/test-ready
	$(PY) -m tests.browser.screenshots docs/images

# Sizes, calls and times, as one table; ARGS="--root FOLDER" for another checkout.
measure: $(VENV)/test-ready
	$(PY) tests/measure.py $(ARGS)

# Which lines and branches the tests run, child processes included; ARGS="tests/unit" for a part.
coverage: $(VENV)/test-ready
	$(PYTEST) --cov --cov-report=term:skip-covered --cov-report=json $(ARGS)

# A virtual environment holds absolute paths: in a clone that was moved it is made anew.
ifneq ($(shell cat $(VENV)/made-in 2>/dev/null),$(CURDIR))
.PHONY: $(VENV)/demo-ready
endif

$(VENV)/demo-ready: pyproject.toml
	$(PYTHON) -m venv --clear $(VENV)
	$(PY) -m pip install --quiet --disable-pip-version-check --editable ".[web]"
	printf '%s\n' "$(CURDIR)" > $(VENV)/made-in
	touch $@

$(VENV)/test-ready: pyproject.toml $(VENV)/demo-ready
	$(PY) -m pip install --quiet --disable-pip-version-check --editable ".[test]"
	touch $@

clean:
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache .coverage .coverage.* coverage.json
