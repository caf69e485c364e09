#!/bin/sh
# The native core on 64-bit ARM, without such a machine: cross-compiled, and run under QEMU.
#
#   sh .ci/neon.sh          its own tests, then as below
#   sh .ci/neon.sh count    the same bytes as on this machine, and how many instructions each kernel takes
#
# After `make dev`. Debian: apt install g++-aarch64-linux-gnu qemu-user
set -eu
cd "$(dirname "$0")/.."
for tool in aarch64-linux-gnu-g++ qemu-aarch64; do
    command -v $tool >/dev/null || {
        echo "evs: no $tool; Debian: apt install g++-aarch64-linux-gnu qemu-user" >&2
        exit 2
    }
done

programs=workload
[ "${1:-}" = count ] || programs='workload selftest'

# build FOLDER PROGRAMS OPTIONS...
build() {
    folder=build/neon/$1
    wanted=$2
    shift 2
    .venv/bin/cmake -S emulator/core -B "$folder" -G Ninja --log-level=WARNING \
        -DCMAKE_MAKE_PROGRAM="$(pwd)/.venv/bin/ninja" -DEVS_STANDALONE=ON "$@" >/dev/null
    # shellcheck disable=SC2086 # a list of programs
    .venv/bin/ninja -C "$folder" --quiet $wanted
}
# here the objects of `make dev`, of which the portable path runs; that it gives the bytes of AVX-512
# and AVX2 is what other tests are for
build here workload -DEVS_ISA=all -DEVS_OBJECTS="$(pwd)/build/native"
build arm "$programs" -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64 \
    -DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++ -DEVS_WERROR=ON
c++ -O2 -shared -fPIC -o build/neon/instructions.so tests/emulator/core/workload/instructions.cpp

arm() {
    qemu-aarch64 -L /usr/aarch64-linux-gnu "$@"
}
[ "${1:-}" = count ] || arm build/neon/arm/selftest

# digest NAME ISA TICKS: checks that it is that of this machine
digest() {
    found=$(arm build/neon/arm/workload "$1" "$2" "$3")
    [ "$found" = "$(build/neon/here/workload "$1" portable "$3")" ] || {
        echo "evs: $1 of $3 ticks, $2: other bytes than on this machine" >&2
        exit 1
    }
}
# count NAME ISA TICKS
count() {
    arm -plugin build/neon/instructions.so build/neon/arm/workload "$1" "$2" "$3" 2>&1 >/dev/null
}
digest absurd portable 8
digest absurd neon 8

# set-up and the first ticks are executed in both runs, and so taken off
echo "instructions a tick, in millions; the bytes are those of this machine"
printf '%-10s %10s %10s %8s\n' work portable neon ratio
while read -r name first last; do
    took=
    for isa in portable neon; do
        digest "$name" $isa "$last"
        took="$took $(($(count "$name" $isa "$last") - $(count "$name" $isa "$first")))"
    done
    echo "$name $((last - first))$took" |
        awk '{ printf "%-10s %10.3f %10.3f %8.2f\n", $1, $3 / $2 / 1e6, $4 / $2 / 1e6, $3 / $4 }'
done <<'END'
direct 4 20
path 1 3
hybrid 1 2
pixels 4 20
network 16 48
END
