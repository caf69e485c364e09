#!/bin/sh
# Run tests side by side, a file at a time in each process, those with slow tests first: two where
# there are two processors, four at most (one may take 1.5 GB).
#
#   sh .ci/tests.sh MARKERS [ARGUMENT...]      as of `pytest -m`
set -eu
cd "$(dirname "$0")/.."
markers=$1
shift
# each process of the tests, and each program that they start, would compile every module anew
unset PYTHONDONTWRITEBYTECODE
# the summary of pytest says how long it took; what took longest stands above it
exec .venv/bin/pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder \
    --durations 10 -m "$markers" "$@"
