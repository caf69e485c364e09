#!/bin/sh
# Every test but the timings, in two processes side by side; run by `make check`.
# The first one's output goes to build/tests.log, and is shown when the other, seen live, has ended.
set -eu
cd "$(dirname "$0")/.."
mkdir -p build
first="tests/emulator tests/msgs"
ignored=""
for folder in $first; do ignored="$ignored --ignore=$folder"; done
# shellcheck disable=SC2086
.venv/bin/pytest -m "not bench" $first >build/tests.log 2>&1 &
process=$!
trap 'kill "$process" 2>/dev/null || true' INT TERM
failed=0
# shellcheck disable=SC2086
.venv/bin/pytest -m "not bench" tests $ignored || failed=$?
wait "$process" || failed=$?
cat build/tests.log
exit "$failed"
