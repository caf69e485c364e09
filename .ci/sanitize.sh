#!/bin/sh
# Build the native core's own tests with the address and undefined-behaviour sanitisers, and run them.
# Without the kernels for AVX2: they are the portable source with wider registers, and compile for
# six minutes under the sanitisers. The other tests run them. With the kernels of one lane, which no
# other build has: here they have to give the bytes of the portable ones.
set -eu
cd "$(dirname "$0")/.."
if [ ! -f build/sanitize/build.ninja ]; then
    .venv/bin/cmake -S emulator/core -B build/sanitize -G Ninja --log-level=WARNING \
        -DCMAKE_MAKE_PROGRAM="$(pwd)/.venv/bin/ninja" -DEVS_SANITIZE=ON -DEVS_WERROR=ON \
        "-DEVS_ISA=portable;avx512;one_lane" >/dev/null
fi
.venv/bin/ninja -C build/sanitize --quiet
ASAN_OPTIONS=strict_string_checks=1:detect_stack_use_after_return=1 \
    UBSAN_OPTIONS=print_stacktrace=1 build/sanitize/selftest
echo "sanitisers: clean"
