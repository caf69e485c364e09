#!/bin/sh
# Everything that a change has to pass: format, lint, types, sanitisers, one lane, versions, a wheel,
# the site, the learners' page, then every test of evs but timings and campaigns, and the quick ones of
# evs-lab. Ends with what each stage took. Run by `make check`; stops at the first stage that fails.
set -eu
cd "$(dirname "$0")/.."
# the tests of each version, the site and the learners would compile every module anew
unset PYTHONDONTWRITEBYTECODE
began=$(date +%s)
stages=''

# stage NAME COMMAND...
stage() {
    name=$1
    shift
    started=$(date +%s)
    echo "== $name"
    failed=0
    "$@" || failed=$?
    stages="$stages$(printf '%6d s  %s' $(($(date +%s) - started)) "$name")
"
    if [ "$failed" -ne 0 ]; then
        report "failed: $name"
        exit "$failed"
    fi
}
report() {
    printf '== %s\n%s%6d s  in all\n' "$1" "$stages" $(($(date +%s) - began))
}
format() {
    .venv/bin/ruff format --check . && .venv/bin/ruff check . &&
        .venv/bin/clang-format --dry-run -Werror \
            $(find emulator/core tests/emulator/core -name '*.cpp' -o -name '*.h' -o -name '*.inl')
}
# the names in the core: .clang-tidy. Other instruction sets compile the same sources
names() {
    find emulator/core -name '*.cpp' ! -name '*avx*' ! -name '*neon*' ! -name '*one_lane*' |
        xargs -P 2 -n 4 .venv/bin/clang-tidy -p build/native --quiet \
            --extra-arg=-Wno-unknown-warning-option --extra-arg=-Wno-error
}
# the two checkers beside each other: each uses one processor
types() {
    .venv/bin/mypy >build/mypy.log 2>&1 &
    beside=$!
    right=0
    .venv/bin/basedpyright || right=$?
    wait "$beside" || right=$?
    cat build/mypy.log
    return "$right"
}

stage "set-up" sh .ci/setup.sh dev
stage "format and lint" format
stage "names in the core" names
# what later stages install, while the next ones compile
(sh .ci/versions.sh install && sh .ci/learners.sh install) >build/environments.log 2>&1 &
environments=$!
trap 'kill "$environments" 2>/dev/null || true' EXIT
stage "types" types
stage "sanitisers" sh .ci/sanitize.sh
stage "one lane" sh .ci/one_lane.sh
# a failure is seen again, and told, in the stage that needs it
wait "$environments" || true
stage "versions of MuJoCo and NumPy" sh .ci/versions.sh
stage "wheel" sh .ci/wheels.sh one
stage "documentation" sh .ci/docs.sh
stage "learners" sh .ci/learners.sh short
stage "tests" sh .ci/tests.sh "not bench and not campaign"
stage "quick tests of evs-lab" sh .ci/tests.sh "not slow and not bench and not campaign" lab/tests
report "clean"
