#!/bin/sh
# Make the checkout ready to run and to edit: .venv with all packages, the native core built in
# place, `import evs` and the command evs. Does only what is not done yet; takes a second then.
#
#   sh .ci/setup.sh [dev]      dev: the tools of `make check` too
set -eu
cd "$(dirname "$0")/.."
checkout=$(pwd)
say() { echo "evs: $*" >&2; }

# .venv: made anew when the checkout has moved, or when the last attempt was cut off
if [ "$(cat .venv/checkout 2>/dev/null)" != "$checkout" ] || ! .venv/bin/python -c '' 2>/dev/null; then
    python=$(sh .ci/prerequisites.sh)
    say "making .venv with $("$python" --version)"
    rm -rf .venv build/native
    "$python" -m venv .venv
    echo "$checkout" >.venv/checkout
fi
python=.venv/bin/python

# what the native core needs of the machine, before the minute that the packages take
if [ ! -f build/native/build.ninja ]; then
    sh .ci/prerequisites.sh >/dev/null
    headers=$(sh .ci/headers.sh $python)
fi

# packages: only when pyproject.toml or the pins ask for something else than last time
install() {
    stamp=.venv/installed-$1
    shift
    { cat .ci/constraints.txt && $python .ci/requirements.py "$@"; } >.venv/wanted
    if ! cmp -s .venv/wanted "$stamp"; then
        say "installing packages ($*): about a minute"
        $python .ci/requirements.py "$@" >.venv/requirements.txt
        $python -m pip install -q --disable-pip-version-check --no-input \
            -c .ci/constraints.txt -r .venv/requirements.txt
        # only for its MJCF files: what else it requires is not needed
        $python -m pip install -q --disable-pip-version-check --no-input \
            --no-deps -c .ci/constraints.txt dm_control
        mv .venv/wanted "$stamp"
    fi
}
install base test build
# tonic reads AEDAT2 and AEDAT3.1 for the tests. It is under the GPL: a venv and a process of its own
if ! .venv/oracles/bin/python -c 'import numpy' 2>/dev/null || [ ! -e .venv/oracles/tonic ]; then
    "$python" -m venv --without-pip .venv/oracles
    $python -m pip --python .venv/oracles/bin/python install -q --disable-pip-version-check \
        --no-input --no-deps -c .ci/constraints.txt numpy tonic
    touch .venv/oracles/tonic
fi
[ "${1:-}" != dev ] || install dev dev

# the native core: configured once, built when a source has changed
if [ ! -f build/native/build.ninja ]; then
    say "building the native core"
    # shellcheck disable=SC2086 # headers is a list of arguments
    .venv/bin/cmake -S emulator/core -B build/native -G Ninja --log-level=WARNING \
        -DCMAKE_MAKE_PROGRAM="$checkout/.venv/bin/ninja" \
        -DPython_EXECUTABLE="$checkout/$python" -DEVS_FARM="$checkout/build/ns" $headers >/dev/null
fi
.venv/bin/ninja -C build/native --quiet >&2

# import evs, and the command
$python .ci/link.py
