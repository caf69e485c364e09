#!/bin/sh
# Which Python, MuJoCo and host library evs's wheels go together with: lab/docs/measured/hosts.md.
# An environment for each combination; arguments: those of matrix.py.
#
#   sh .ci/wheels.sh native && sh .ci/matrix.sh --markdown lab/docs/measured/hosts.md
set -eu
cd "$(dirname "$0")/.."
sh .ci/setup.sh dev
exec .venv/bin/python tests/versions/matrix.py --uv "$(pwd)/.venv/bin/uv" "$@"
