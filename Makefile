# Needs Python 3.11 to 3.13 and a C++ compiler; everything else is fetched. See `make help`.

MAKEFLAGS += --no-print-directory
activate = . ./activate.sh

.PHONY: help setup test lint lock clean distclean

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 12

setup: ## .venv, the ROS 2 workspace and activate.sh (PYTHON=python3.12 chooses the Python)
	@PYTHON="$(PYTHON)" tools/setup.sh

test: lint ## lint, then the tests (ARGS="-k friction" goes to pytest)
	$(activate) && pytest $(ARGS)

lint: setup ## style, types and import contracts
	$(activate) && ruff check
	$(activate) && basedpyright
	$(activate) && lint-imports --no-logo

lock: setup ## compile requirements/lock.txt anew (ARGS=--upgrade takes newer versions)
	tools/lock.sh $(ARGS)

clean: ## remove what was built
	rm -rf activate.sh ros2_ws/build ros2_ws/install ros2_ws/log
	rm -rf .pytest_cache .ruff_cache .import_linter_cache
	find ema_* tests -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## remove .venv as well
	rm -rf .venv
