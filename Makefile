# The commands of this project. Any make will do; `make` alone lists them.
.POSIX:
.PHONY: help demo test check lab campaign bench docs dev format sanitize versions wheel wheels clean

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

# make demo      a humanoid seen by an event camera for 1 s: stream, recording, pictures in out/demo
demo:
	@sh .ci/setup.sh demo
	.venv/bin/evs demo

# make test      the quick tests, to run before a commit
test:
	@sh .ci/setup.sh
	@sh .ci/tests.sh "not slow and not statistical and not extremes and not integration and not bench and not campaign"

# make check     format, lint, types, sanitisers, one lane, versions, a wheel, all tests of evs and the quick ones of evs-lab: CI
check:
	@sh .ci/check.sh

# make lab       every test of evs-lab but timings and campaigns
lab:
	@sh .ci/setup.sh
	@sh .ci/tests.sh "not bench and not campaign" lab/tests

# make campaign  what is too long for make check: all of evs-lab, 120,000 damaged files, a million resets, all sanitisers, ...
campaign:
	@sh .ci/setup.sh
	@sh .ci/tests.sh campaign tests lab/tests
	@sh .ci/tests.sh "slow and not bench and not campaign" lab/tests
	@sh .ci/sanitize.sh wide

# make docs      the site, in build/docs
docs:
	@sh .ci/docs.sh

# make bench     timings
bench:
	@sh .ci/setup.sh
	.venv/bin/pytest -m "bench and not slow" -s lab/tests/bench

# make dev       only the set-up: .venv, the native core in place, the tools of make check
dev:
	@sh .ci/setup.sh dev

# make format    format every source file
format:
	@sh .ci/setup.sh dev
	.venv/bin/ruff format .
	.venv/bin/clang-format -i $$(find emulator/core tests/emulator/core -name '*.cpp' -o -name '*.h' -o -name '*.inl')

# make sanitize  build and run the native core's own tests under ASan and UBSan
sanitize:
	@sh .ci/setup.sh
	@sh .ci/sanitize.sh

# make versions  a quick part of the tests with each MuJoCo and NumPy of .ci/versions.sh
versions:
	@sh .ci/setup.sh dev
	@sh .ci/versions.sh

# make wheel     dist/evs-*.whl for this machine's Python and glibc
wheel:
	@sh .ci/setup.sh
	.venv/bin/python -m pip wheel -q --disable-pip-version-check --no-deps --no-build-isolation -w dist .

# make wheels    those of a release: for every Python and old systems, x86-64 and 64-bit ARM, checked
wheels:
	@sh .ci/wheels.sh

# make clean     remove everything that these commands made
clean:
	rm -rf .venv build dist out emulator/_core*.so
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
	rm -rf .pytest_cache .ruff_cache .mypy_cache .hypothesis MUJOCO_LOG.TXT
