#!/bin/sh
# Build the native core's own tests with the address and undefined-behaviour sanitisers, and run them.
# The kernels of one lane, which no other build has, are the source of all kernels with plain floats:
# they have all checks, and must give the bytes of the portable ones, which come from build/native
# without any. Those of wide registers compile for half an hour of a processor with the checks, so
# these are for a release.
#
#   sh .ci/sanitize.sh          what CI runs
#   sh .ci/sanitize.sh wide     with the checks in the portable kernels and those for AVX-512 too
set -eu
cd "$(dirname "$0")/.."
place=build/sanitize
options="-DEVS_ISA=portable;one_lane -DEVS_OBJECTS=$(pwd)/build/native"
if [ "${1:-}" = wide ]; then
    place=build/sanitize-wide
    options="-DEVS_SANITIZE_WIDE=ON -DEVS_ISA=portable;avx512;one_lane"
fi
if [ ! -f "$place/build.ninja" ]; then
    # shellcheck disable=SC2086 # a list of options
    .venv/bin/cmake -S emulator/core -B "$place" -G Ninja --log-level=WARNING \
        -DCMAKE_MAKE_PROGRAM="$(pwd)/.venv/bin/ninja" -DEVS_SANITIZE=ON -DEVS_WERROR=ON \
        $options >/dev/null
fi
.venv/bin/ninja -C "$place" --quiet selftest
ASAN_OPTIONS=strict_string_checks=1:detect_stack_use_after_return=1 \
    UBSAN_OPTIONS=print_stacktrace=1 "$place/selftest"
echo "sanitisers: clean"
