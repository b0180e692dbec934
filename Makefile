# Everything starts here. Each target sets up what it needs: `make demo` and `make test`
# work from a fresh clone.

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
  "$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && exit; \
  done; echo python3)
BIN := .venv/bin
READY := .venv/.ready

.PHONY: help client demo test lint format verify bench clean
.DEFAULT_GOAL := help

help:
	@echo "make demo     the editor on an example, in the browser"
	@echo "make test     lint, then run the tests"
	@echo "make lint     ruff, mypy --strict, the import rules"
	@echo "make format   let ruff rewrite the sources"
	@echo "make verify   every acceptance figure at full size, with one report"
	@echo "make bench    timings, each a ratio within one run"
	@echo "make client   the editor's page, when its sources have changed"
	@echo "make clean    remove what the other targets made"

$(READY): pyproject.toml bootstrap.py hatch_build.py
	@$(PYTHON) bootstrap.py
	@touch $@

client: $(READY)
	@$(BIN)/python client/build.py

demo: client
	@$(BIN)/python -m burnish.app.demo

test: lint client
	@$(BIN)/python bootstrap.py --browser
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

verify: $(READY)
	$(BIN)/python -m pytest -m verify

bench: $(READY)
	$(BIN)/python -m bench

clean:
	rm -rf .venv build dist demo-output client/node_modules src/burnish/app/static .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
