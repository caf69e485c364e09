#!/bin/sh
# Make the checkout ready to run and to edit: .venv with packages, the native core built in place,
# `import evs` and the command evs. Does only what is not done yet; takes a second then.
#
#   sh .ci/setup.sh [LEVEL]
#       demo    what evs itself requires; the core for this machine's processor only
#       test    and what the tests run on; the core for every instruction set (the default)
#       dev     and the tools of `make check`
#       docs    what `make docs` builds the site with, too
set -eu
cd "$(dirname "$0")/.."
checkout=$(pwd)
level=${1:-test}
case $level in
demo | test | dev | docs) ;;
*) echo "evs: no level '$level': demo, test, dev or docs" >&2 && exit 2 ;;
esac
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
mkdir -p build

# what the native core needs of the machine, before the time that the packages take
if [ ! -f build/native/build.ninja ]; then
    sh .ci/prerequisites.sh >/dev/null
    headers=$(sh .ci/headers.sh $python)
fi

# pip install ARGUMENT..., for the Python of $into. It heeds the settings that a machine has for it;
# uv, which the tools of `make check` bring, takes a quarter of the time and keeps what it fetched.
# Python compiles what it imports by itself, most is never
into=$python
pip() {
    if [ -x .venv/bin/uv ]; then
        .venv/bin/uv pip install --python "$into" -c .ci/constraints.txt "$@"
    else
        $python -m pip --python "$into" install --no-compile --disable-pip-version-check --no-input \
            --progress-bar off -c .ci/constraints.txt "$@"
    fi
}

# packages of these extras, only when pyproject.toml or the pins ask for something else than last time
is_wanted() {
    { cat .ci/constraints.txt && $python .ci/requirements.py "$@"; } >".venv/wanted-$1"
    ! cmp -s ".venv/wanted-$1" ".venv/installed-$1"
}
install() {
    $python .ci/requirements.py "$@" >".venv/requirements-$1.txt"
    pip -r ".venv/requirements-$1.txt"
    # of these only some files are read: what they require is not needed
    [ "$1" != test ] || pip --no-deps dm_control
    mv ".venv/wanted-$1" ".venv/installed-$1"
}
# tonic reads AEDAT2 and AEDAT3.1 for the tests. It is under the GPL: a venv and a process of its own
install_oracles() {
    [ ! -e .venv/oracles/tonic ] || ! .venv/oracles/bin/python -c 'import numpy' 2>/dev/null || return 0
    $python -m venv --without-pip .venv/oracles
    (into=.venv/oracles/bin/python && pip --no-deps numpy tonic)
    touch .venv/oracles/tonic
}
install_all() {
    if [ "$level" = demo ]; then
        if is_wanted build; then install build; fi
        return 0
    fi
    case $level in
    dev | docs) [ -x .venv/bin/uv ] || pip uv ;;
    esac
    if is_wanted test build; then install test build; fi
    install_oracles
    case $level in
    dev | docs) if is_wanted "$level"; then install "$level"; fi ;;
    esac
}

# the tools that build the core come first, everything else is installed while it is compiled
if ! .venv/bin/cmake --version >/dev/null 2>&1 || ! .venv/bin/ninja --version >/dev/null 2>&1 ||
    ! $python -c 'import nanobind' 2>/dev/null; then
    say "installing what builds the core"
    $python .ci/requirements.py --alone build >.venv/requirements-first.txt
    pip -q -r .venv/requirements-first.txt
fi
log=$checkout/build/packages.log
(set -e && install_all) >"$log" 2>&1 &
packages=$!
trap 'kill "$packages" 2>/dev/null || true' EXIT
trap 'exit 130' INT TERM

# the native core: configured once, and again for every instruction set when the demo had one only, or
# for errors in place of warnings, which `make check` asks for
configure() {
    # shellcheck disable=SC2086 # headers is a list of arguments
    .venv/bin/cmake -S emulator/core -B build/native -G Ninja --log-level=WARNING \
        -DCMAKE_MAKE_PROGRAM="$checkout/.venv/bin/ninja" -DPython_EXECUTABLE="$checkout/$python" \
        -DEVS_FARM="$checkout/build/ns" "$@" >/dev/null
}
strict=OFF
[ "$level" != dev ] || strict=ON
if [ ! -f build/native/build.ninja ]; then
    say "building the native core; packages are installed meanwhile (build/packages.log)"
    isa=all
    [ "$level" != demo ] || isa=native
    # shellcheck disable=SC2086
    configure -DEVS_ISA=$isa -DEVS_WERROR=$strict $headers
elif [ "$strict" = ON ] && grep -q '^EVS_WERROR:BOOL=OFF' build/native/CMakeCache.txt; then
    say "building the native core with warnings as errors"
    configure -DEVS_ISA=all -DEVS_WERROR=ON
elif [ "$level" != demo ] && grep -q '^EVS_ISA:STRING=native' build/native/CMakeCache.txt; then
    say "building the native core for the other instruction sets too"
    configure -DEVS_ISA=all
fi
(cd build/native && NINJA_STATUS='evs: core %f of %t, %es  ' ../../.venv/bin/ninja >&2)

# the packages, if they take longer: which one is at hand
told=
while kill -0 "$packages" 2>/dev/null; do
    now=$(sed -n 's/^\(Collecting [^ <>=!~;[]*\|Installing collected packages\).*/\1/p' "$log" | tail -n 1)
    if [ "$now" != "$told" ]; then
        if [ -t 2 ]; then printf '\r\033[Kevs: packages: %s ' "$now" >&2; else say "packages: $now"; fi
        told=$now
    fi
    sleep 0.2
done
[ ! -t 2 ] || [ -z "$told" ] || printf '\r\033[K' >&2
if ! wait "$packages"; then
    cat "$log" >&2
    exit 1
fi
trap - EXIT

# import evs, and the command; evs_lab too but for the demo
lab=lab
[ "$level" != demo ] || lab=
# shellcheck disable=SC2086 # nothing where it is empty
$python .ci/link.py $lab
