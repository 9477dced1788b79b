# Needs Python 3.11 to 3.13 and a C++ compiler; everything else is fetched. See `make help`.

MAKEFLAGS += --no-print-directory
activate = . ./activate.sh
DEMO_S ?= 60
ROBOT_S ?= 420
# If a test crashes its process or exceeds its time limit, pytest names it and continues with the rest.
# Bytecode is written for any setting of the shell. Otherwise, each process that a test starts compiles
# all of its modules, and pytest compiles all tests.
pytest = env -u PYTHONDONTWRITEBYTECODE pytest --dist loadfile --no-loadscope-reorder
numerics = tests/core tests/sim tests/monitor tests/prognosis tests/study tests/inputs

.PHONY: demo-robot colcon-test package-files test-pythons docs parameters records policies page test-web bench-web screenshots help setup test tests test-long quick soak pip-check lint style types demo bench campaign size words calibration sample lock sbom clean distclean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 14

setup: ## create .venv, the ROS 2 workspace and activate.sh (PYTHON=python3.12 selects the Python)
	@PYTHON="$(PYTHON)" tools/setup.sh

test: setup ## check style, words, types and import contracts, and run the tests (ARGS="-k friction" goes to pytest)
	@$(MAKE) style
	@$(MAKE) -j 2 types tests

# The tests of nodes wait half of the time: a third process uses the idle time of two cores.
tests: setup
	$(activate) && $(pytest) -n 3 -m "not long" $(ARGS)

test-long: setup ## the tests that `make test` leaves out: the study of the thesis, long bags, many repetitions
	$(activate) && $(pytest) -n 2 -m long --ignore tests/attacks $(ARGS)

quick: setup ## the quick tests of the numerics, without ROS
	$(activate) && $(pytest) -n 2 --without-ros -m "not slow and not long" $(numerics) $(ARGS)

colcon = cd ros2_ws && python -m colcon --log-base log
colcon-test: setup ## run the quick tests of each package, as `colcon test` does
	$(activate) && $(colcon) test-result --delete-yes >/dev/null
	$(activate) && $(colcon) test --paths ../ema_* src/ema_* --event-handlers console_direct-
	$(activate) && $(colcon) test-result --all --verbose
	$(activate) && $(colcon) test-result --all | ../tools/colcon_results.py

test-pythons: ## set-up, `make quick` and a demo of 10 s with each installed Python from 3.11 to 3.13
	tools/test_pythons.sh $(ARGS)

parameters: setup ## write docs/parameters.md from the declarations of the nodes
	$(activate) && python tools/parameter_page.py

records: setup ## write docs/records.md from the definitions of estimate, health and reasons
	$(activate) && python tools/records.py

policies: setup ## write the policies of SROS2 from the topics and services of the nodes
	$(activate) && python -m ema_cli.policies

package-files: setup ## write metadata, changelog and licence of each package, and requirements of a ROS workspace
	$(activate) && python tools/package_files.py

soak: setup ## run the tests of nodes twenty times, ten times under the load of 8 busy processes
	$(activate) && python tools/soak.py $(ARGS)

pip-check: setup ## install the library by pip without ROS, and identify a recorded window
	tools/pip_check.sh

# Users do not need the packages of the page: the bundle is shipped.
web = ros2_ws/src/ema_dashboard/web
$(web)/node_modules: $(web)/package-lock.json
	@command -v npm >/dev/null || { echo "npm is not on the path: install nodejs and npm" >&2; exit 1; }
	cd $(web) && npm ci --no-progress
	@touch $@

page: setup $(web)/node_modules ## bundle the dashboard's page; needed after a change in ros2_ws/src/ema_dashboard/web
	$(activate) && python tools/page_registry.py
	cd $(web) && npx tsc && node build.mjs

test-web: setup $(web)/node_modules ## test the page in a real browser; needs Node and Chromium on the path
	@for one in $(CHROMIUM) chromium chromium-browser google-chrome; do \
	    command -v $$one >/dev/null && exit 0; done; \
	    echo "no Chromium on the path: install it, or name it with CHROMIUM=/path/to/it" >&2; exit 1
	cd $(web) && npx tsc && node build.mjs --check
	$(activate) && cd $(web) && node --test --test-concurrency=1 test/*.test.mjs

bench-web: setup $(web)/node_modules ## measure the first paint of the page, then main thread and memory with 200 actuators for 10 minutes
	$(activate) && cd $(web) && LOAD_S=600 node --test test/load.bench.mjs

screenshots: setup $(web)/node_modules ## write pictures of every state of the page to docs/screens
	$(activate) && cd $(web) && node test/screenshots.mjs ../../../../docs/screens

lint: style types ## check style, words, types and import contracts

style: setup
	$(activate) && ruff check
	$(activate) && lint-imports --no-logo
	$(activate) && python tools/words.py

types: setup
	$(activate) && basedpyright

# exec: the demo itself receives signals to make.
demo: setup ## watch an actuator wear out: live table, bag and picture (DEMO_S=60 sets its length)
	@$(activate) && exec ema demo --duration $(DEMO_S)

demo-robot: setup ## attach to a simulated arm with two joints that wear (ROBOT_S=420 sets its length)
	@$(activate) && exec ema demo --robot --duration $(ROBOT_S)

bench: setup ## measure all targets of speed and accuracy in one table, with JSON and plots; takes an hour
	$(activate) && cd benchmarks && python kernels.py --json kernels.json
	$(activate) && cd benchmarks && python accuracy.py --json accuracy.json
	$(activate) && cd benchmarks && python field_oriented.py --json field_oriented.json
	$(activate) && cd benchmarks && python trust.py --json trust.json
	$(activate) && cd benchmarks && python sensor_errors.py --json sensor_errors.json
	$(activate) && cd benchmarks && python sampling.py --json sampling.json
	$(activate) && cd benchmarks && python design.py --json design.json
	$(activate) && cd benchmarks && python ordinary_motion.py --json ordinary_motion.json
	$(activate) && cd benchmarks && python departures.py --json departures.json
	$(activate) && cd benchmarks && python joints.py --json joints.json
	$(activate) && cd benchmarks && python live.py --json live.json
	$(activate) && cd benchmarks && python many_actuators.py --json many_actuators.json
	$(activate) && cd benchmarks && python many_joints.py --json many_joints.json
	$(activate) && cd benchmarks && python learning.py --json learning.json
	$(activate) && cd benchmarks && python promptness.py --json promptness.json
	$(activate) && cd benchmarks && python dashboard.py --json dashboard.json
	$(activate) && cd benchmarks && python startup.py --json startup.json
	$(activate) && cd benchmarks && python resume.py --json resume.json
	$(activate) && cd benchmarks && python memory.py --json memory.json
	$(activate) && cd benchmarks && python archive.py --json archive.json
	$(activate) && cd benchmarks && python -m prognosis.own_laws --json own_laws.json
	$(activate) && cd benchmarks && python -m prognosis.foreign_laws --json foreign_laws.json
	$(activate) && cd benchmarks && python advisory.py --json advisory.json
	$(activate) && cd benchmarks && python summary.py

campaign: setup ## attack the monitor for hours: kills, disturbed graphs, random walks, fuzzing, a soak (docs/campaign.md)
	$(activate) && EMA_ATTACKS=$${EMA_ATTACKS:-10} $(pytest) -n 1 -o faulthandler_timeout=0 tests/attacks $(ARGS)

words: ## find unclear words in documents, messages, docstrings and comments
	@python3 tools/words.py

size: ## print lines of code, packages and the largest file
	@python3 tools/size.py

calibration: setup ## repeat the shipped calibration; needed after a change of simulator or monitor model
	$(activate) && ema simulate --cycles 20 --replace -o ros2_ws/build/healthy.mcap
	$(activate) && ema calibrate ros2_ws/build/healthy.mcap --replace \
	    -o ema_monitor/ema_monitor/calibration/builtin_calibration.yaml

sample: setup ## write the sample bag; needed after a change of the reference actuator or the messages
	$(activate) && ema simulate --fault friction=0.25 --fault eccentricity=0.1 \
	    --fault eccentricity_phase=0.7 --current-noise 0.02 \
	    -p resolution.current=0.005 -p resolution.position=1e-6 \
	    -p resolution.speed=0.05 --seed 1 --replace -o bags/faulty_flap.mcap

docs: setup ## build the site of the documents in site/: pages, Python reference, search; checks links
	NO_MKDOCS_2_WARNING=1 tools/in_venv.sh docs mkdocs build
	@echo 'docs: open site/index.html; for its search, python3 -m http.server --directory site'

lock: setup ## compile all locks with hashes (ARGS=--upgrade selects newer versions)
	tools/lock.sh $(ARGS)

sbom: setup ## write ema.cdx.json: all packages that are installed or shipped, as CycloneDX
	tools/in_venv.sh sbom python tools/sbom.py ema.cdx.json

clean: ## remove build results
	rm -rf activate.sh site ros2_ws/build ros2_ws/install ros2_ws/log
	rm -rf .pytest_cache .ruff_cache .import_linter_cache
	find ema_* ros2_ws/src tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## remove .venv as well
	rm -rf .venv .venv-peers .venv-sbom .venv-docs
