#!/bin/sh
# What a machine must bring: Python >= 3.11 with venv, and a C++20 compiler. Prints the Python to use.
# Anything missing: one line on stderr that names it and the fix, exit code 2.
# $PYTHON and $CXX, where set, are taken as they are.
set -eu

missing() {
    echo "evs: $1" >&2
    exit 2
}

# a Python that is new enough: the first of these
fit=
found=
for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
    version=$("$candidate" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null) || continue
    found="$found $candidate is $version"
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        fit=$candidate
        break
    fi
done
if [ -z "$fit" ] && [ -z "$found" ]; then
    missing "Python 3.11 or newer is missing (looked for ${PYTHON:-python3}); on Debian: apt install python3 python3-venv"
elif [ -z "$fit" ]; then
    missing "Python is too old ($(echo $found)), 3.11 or newer is needed; on Debian 12: apt install python3 python3-venv"
fi
"$fit" -c 'import venv, ensurepip' 2>/dev/null ||
    missing "the venv module of $fit is missing; on Debian: apt install python3-venv"

# a compiler that says it knows C++20, has the vectors that the core is written with (g++ 11 lacks
# __builtin_shufflevector), and can link; emulator/core/linking/toolchain.cmake asks the same of `pip install`
compiler=
for candidate in ${CXX:-c++ g++ clang++}; do
    if command -v "$candidate" >/dev/null 2>&1; then
        compiler=$candidate
        break
    fi
done
[ -n "$compiler" ] ||
    missing "a C++20 compiler is missing (looked for ${CXX:-c++, g++, clang++}); on Debian: apt install g++"
trial=$(mktemp -d)
trap 'rm -rf "$trial"' EXIT
cat >"$trial/trial.cpp" <<'END'
#if __cplusplus < 202002L
#error too old
#endif
#include <bit>
#include <vector>
using Four = float __attribute__((vector_size(16)));
Four both(Four a, Four b) { return __builtin_shufflevector(a, b, 0, 4, 1, 5); }
int main() { return std::vector<unsigned>(1, std::bit_width(1u)).size() != 1; }
END
"$compiler" -std=c++20 -o "$trial/trial" "$trial/trial.cpp" >/dev/null 2>&1 ||
    missing "$compiler cannot build evs ($("$compiler" --version 2>&1 | head -n 1)), g++ 12 or newer is needed; on Debian and Ubuntu: apt install g++-12, then set CXX=g++-12"

echo "$fit"
