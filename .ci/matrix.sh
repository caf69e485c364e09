#!/bin/sh
# Which Python, MuJoCo and host library evs's wheels go together with: lab/docs/measured/hosts.md.
# An environment for each combination; arguments: those of matrix.py.
#
#   sh .ci/wheels.sh native && sh .ci/matrix.sh --markdown lab/docs/measured/hosts.md
set -eu
cd "$(dirname "$0")/.."
tools=build/matrix/tools
if [ ! -x $tools/bin/uv ]; then
    .venv/bin/python -m venv $tools
    $tools/bin/python -m pip install -q --disable-pip-version-check uv
fi
exec .venv/bin/python tests/versions/matrix.py --uv $tools/bin/uv "$@"
