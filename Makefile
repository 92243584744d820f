# make install           gatjax into .venv, which the others do first
# make run               collect, ground, search, evaluate, report (the demo preset)
# make run ARGS="..."    the same with arguments for `gatjax run`, e.g. ARGS="--resume"
# make test              lint, formatting, import rules, types, tests
# make bench             benchmarks; they are never part of the tests
# make picture           docs/report.png, from the latest run (needs chromium)
# make clean             remove .venv, caches and builds; run folders stay
#
# Needs make and Python 3.11 or newer. Choose one with PYTHON=/path/to/python3.

PYTHON ?= python3
ARGS ?=
BIN := .venv/bin
PINS := pyproject.toml constraints.txt

# Pip takes its pins from here for the package and, by the second name, for its build.
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Pyright would otherwise ask the network whether there is a newer pyright.
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

.PHONY: install run test bench picture clean
.NOTPARALLEL:

install: .venv/installed

run: .venv/installed
	@$(BIN)/gatjax run $(ARGS)

test: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/pyright
	$(BIN)/pytest -n 2 --dist worksteal $(ARGS)

bench: .venv/installed-dev
	$(BIN)/pytest benchmarks --override-ini=addopts= --benchmark-only $(ARGS)

picture:
	chromium --headless --no-sandbox --disable-gpu --hide-scrollbars \
	--virtual-time-budget=4000 --window-size=1200,1560 --screenshot=docs/report.png \
	"file://$(CURDIR)/$$(ls -d runs/*/ | tail -1)report.html"

clean:
	rm -rf .venv .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	rm -rf .benchmarks build dist
	find gatjax tests -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	{ echo "gatjax needs Python 3.11 or newer, and '$(PYTHON)' is not:" \
	"call make with PYTHON=/path/to/python3.11" >&2; exit 1; }
	@$(PYTHON) -m venv --clear .venv
	@touch $@

.venv/installed: .venv/created $(PINS)
	@echo "Installing gatjax into .venv (once, about a minute)"
	@$(BIN)/pip install --quiet --editable .
	@touch $@

.venv/installed-dev: .venv/created $(PINS)
	@echo "Installing gatjax and its test tools into .venv (once, about a minute)"
	@$(BIN)/pip install --quiet --editable '.[dev]'
	@touch $@ .venv/installed
