#!/bin/sh
# The wheels that a release has, into dist/: built, audited, and run away from the checkout.
#
#   sh .ci/wheels.sh [TARGET...]     everything but `one` by default
#       native    for this machine's processor: CPython 3.11, and one for 3.12 and every later version
#       aarch64   the same, compiled on x86-64, and run in an emulator
#       macos     no wheel: compiles and links the core for Macs with Apple silicon, and audits the module
#       one       one of `native` only: a stage of `make check`
#
# A wheel loads on every Linux with glibc 2.17 or newer. The objects are those of build/native, which
# do not depend on Python; linking/old_glibc.cmake says how the linker is made to look for old symbols.
set -eu
cd "$(dirname "$0")/.."
checkout=$(pwd)
home=$checkout/build/wheels
glibc=2.17
mkdir -p "$home" dist

say() { echo "evs: $*" >&2; }
missing() {
    say "$*"
    exit 2
}

# a command of Debian's packages: installed where this is root, else one line
need() {
    command -v "$1" >/dev/null && return 0
    [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null ||
        missing "$1 is missing; on Debian: apt install $2"
    say "installing $2"
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$2"; } \
        </dev/null >"$home/apt.log" 2>&1 || { cat "$home/apt.log" >&2 && missing "no $1: $2 cannot be installed"; }
}

# pip FOLDER WHAT...: into an environment
pip() {
    into=$1
    shift
    .venv/bin/uv pip install -q --python "$into/bin/python" -c .ci/constraints.txt "$@"
}

# the Python of this version: .venv's, one on the path, or one of pyenv's; nothing where there is none
find_python() {
    for candidate in .venv/bin/python "python$1" "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*/bin/python; do
        "$candidate" -c "import os, sys
if '%d.%d' % sys.version_info[:2] != '$1': sys.exit(1)
print(os.path.realpath(sys.executable))" 2>/dev/null || continue
        return 0
    done
}

# an environment that builds wheels with this Python: its folder
builder() {
    folder=$home/build-$1
    .venv/bin/python .ci/requirements.py --alone build >"$home/build.txt"
    if ! { echo "$2" && cat "$home/build.txt" .ci/constraints.txt; } | cmp -s - "$folder/made-of"; then
        rm -rf "$folder"
        "$2" -m venv "$folder"
        pip "$folder" -r "$home/build.txt" >&2
        { echo "$2" && cat "$home/build.txt" .ci/constraints.txt; } >"$folder/made-of"
    fi
    echo "$folder"
}

# build VERSION PYTHON ARCH OBJECTS [CMAKE_ARGUMENT...]: the path of a new wheel, audited, in dist/
build() {
    version=$1 arch=$3 objects=$4
    environment=$(builder "$1" "$2")
    headers=$(sh .ci/headers.sh "$environment/bin/python")
    shift 4
    raw=$home/raw
    rm -rf "$raw" && mkdir "$raw"
    # shellcheck disable=SC2086 # headers is a list of arguments
    set -- $headers "$@" "-DEVS_OBJECTS=$objects" "-DEVS_GLIBC=$glibc" "-DEVS_WERROR=ON" \
        "-DEVS_ZIG=$home/tools/bin/python;-m;ziglang"
    count=$#
    while [ "$count" -gt 0 ]; do
        set -- "$@" -C "cmake.define.${1#-D}"
        shift
        count=$((count - 1))
    done
    (
        # what scikit-build-core calls the machine that the wheel is for
        export _PYTHON_HOST_PLATFORM="linux-$arch"
        export SETUPTOOLS_EXT_SUFFIX=".cpython-$(echo "$version" | tr -d .)-$arch-linux-gnu.so"
        export PATH="$environment/bin:$PATH"
        "$environment/bin/python" -m pip wheel -q --disable-pip-version-check --no-deps \
            --no-build-isolation -w "$raw" "$@" . >&2
    )
    PATH="$home/tools/bin:$PATH" "$home/tools/bin/auditwheel" -v repair -w "$raw/repaired" "$raw"/evs-*.whl \
        >"$home/auditwheel.log" 2>&1 || { cat "$home/auditwheel.log" >&2 && return 1; }
    "$home/tools/bin/python" .ci/audit_wheel.py "$raw"/repaired/evs-*.whl >&2
    case $(echo "$raw"/repaired/*) in
    *-abi3-*) "$home/tools/bin/abi3audit" --strict --summary "$raw"/repaired/evs-*.whl >&2 ;;
    esac
    name=$(basename "$raw"/repaired/evs-*.whl)
    mv "$raw/repaired/$name" dist/
    echo "dist/$name"
}

# what runs on a wheel: the golden bytes of light and events, and those of MuJoCo's worlds
TESTS='tests/emulator/render/test_render_digest.py tests/emulator/world/test_world_digest.py'
copy_tests() {
    rm -rf "$1" && mkdir -p "$1/tests"
    # shellcheck disable=SC2086 # a list of files
    cp $TESTS "$1/tests"
    cp -R tests/support "$1/support"
    cp .ci/installed_at.py "$1/tests/conftest.py"
    printf '[pytest]\npythonpath = support\naddopts = --import-mode=importlib\nmarkers = golden: bytes\n' \
        >"$1/pytest.ini"
}

# run_golden WHEEL PYTHON: in an empty environment, in a folder that has nothing else
run_golden() {
    trial=$(mktemp -d)
    "$2" -m venv --without-pip "$trial/env"
    pip "$trial/env" "$checkout/$1" pytest
    copy_tests "$trial/run"
    failed=0
    (cd "$trial/run" && EVS_INSTALLED_IN="$trial/env" MUJOCO_GL=disable \
        "$trial/env/bin/python" -m pytest -q -p no:cacheprovider tests) || failed=$?
    # the bytes are those of any instruction set: it must take the best one, as the checkout does
    best='from evs.emulator import _core; print(*_core.isa_available())'
    found=$(cd "$trial" && env/bin/python -c "$best") wanted=$(.venv/bin/python -c "$best")
    rm -rf "$trial"
    [ "$failed" -eq 0 ] || return "$failed"
    [ "$found" = "$wanted" ] || missing "$1 has the instruction sets '$found', and the checkout '$wanted'"
    say "$1 has the golden bytes on $("$2" --version), and $found"
}

native() {
    arch=$(uname -m)
    abi3=
    for version in 3.12 3.13 3.14; do
        python=$(find_python "$version")
        [ -n "$python" ] || continue
        [ -n "$abi3" ] || { say "cp312-abi3 by $("$python" --version)" &&
            abi3=$(build "$version" "$python" "$arch" "$checkout/build/native"); }
        run_golden "$abi3" "$python"
        [ "$1" = all ] || return 0
    done
    python=$(find_python 3.11)
    if [ -n "$python" ]; then
        say "cp311 by $("$python" --version)"
        wheel=$(build 3.11 "$python" "$arch" "$checkout/build/native")
        run_golden "$wheel" "$python"
    elif [ -z "$abi3" ]; then
        missing "no Python from 3.11 to 3.14 to build a wheel with"
    fi
    [ -n "$abi3" ] || [ "$1" != all ] || missing "Python 3.12 or newer is missing: there is no wheel for it"
    [ -n "$python" ] || [ "$1" != all ] || missing "Python 3.11 is missing: there is no wheel for it"
}

# the objects, compiled by Debian's cross compiler; arm64's Python and packages run in an emulator
aarch64() {
    [ "$(uname -m)" = x86_64 ] || missing "the target aarch64 is for x86-64; here it is \`native\`"
    need aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
    need qemu-aarch64 qemu-user
    cross=$home/aarch64
    python=$(find_python 3.11)
    [ -n "$python" ] || python=$(find_python 3.12)
    [ -n "$python" ] || missing "no Python 3.11 or 3.12 to build a wheel with"
    environment=$(builder cross "$python")
    toolchain=-DCMAKE_TOOLCHAIN_FILE=$checkout/.ci/aarch64.cmake
    if [ ! -f "$cross/build.ninja" ]; then
        PATH="$environment/bin:$PATH" "$environment/bin/cmake" -S emulator/core -B "$cross" -G Ninja \
            --log-level=WARNING "$toolchain" -DPython_EXECUTABLE="$environment/bin/python" \
            -DEVS_WERROR=ON >/dev/null
    fi
    "$environment/bin/ninja" -C "$cross" --quiet evs_native
    unpack_arm64
    arm_version=$(emulated -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    for version in 3.11 3.12; do
        python=$(find_python "$version")
        [ -n "$python" ] || continue
        say "aarch64 by $("$python" --version)"
        wheel=$(build "$version" "$python" aarch64 "$cross" "$toolchain")
        case $version/$arm_version in
        3.11/3.11 | 3.12/3.1[2-9]) run_emulated "$wheel" "$arm_version" ;;
        *) say "$wheel was not run: the emulator has Python $arm_version" ;;
        esac
    done
}

# Debian's Python for arm64 with what it needs, in a folder; the system stays as it is
unpack_arm64() {
    [ ! -e "$home/arm64/root/unpacked" ] || return 0
    say "fetching Python for arm64"
    rm -rf "$home/arm64"
    mkdir -p "$home/arm64/root" "$home/arm64/lists/partial" "$home/arm64/archives/partial"
    : >"$home/arm64/status"
    set -- -qq -o APT::Architecture=arm64 -o APT::Architectures=arm64 -o Dir::State="$home/arm64" \
        -o Dir::State::status="$home/arm64/status" -o Dir::Cache="$home/arm64" -o APT::Sandbox::User=root \
        -o Debug::NoLocking=1
    {
        apt-get "$@" update &&
            apt-get "$@" --download-only --no-install-recommends -y install python3 libstdc++6 </dev/null
    } >"$home/apt.log" 2>&1 || { cat "$home/apt.log" >&2 && missing "no Python for arm64 among Debian's packages"; }
    for package in "$home"/arm64/archives/*.deb; do dpkg -x "$package" "$home/arm64/root"; done
    touch "$home/arm64/root/unpacked"
}
emulated() {
    qemu-aarch64 -L "$home/arm64/root" "$home/arm64/root/usr/bin/python3" "$@"
}

# run_emulated WHEEL VERSION: as run_golden
run_emulated() {
    trial=$(mktemp -d)
    set -- "$1" "$2" --only-binary :all: --python-version "$2"
    for platform in manylinux_2_28 manylinux_2_27 manylinux_2_26 manylinux_2_17 manylinux2014; do
        set -- "$@" --platform "${platform}_aarch64"
    done
    wheel=$1
    shift 2
    # shellcheck disable=SC2086 # a list of arguments
    "$home/tools/bin/python" -m pip install -q --no-compile --disable-pip-version-check --no-input -c .ci/constraints.txt --target "$trial/site" "$@" "$checkout/$wheel" pytest
    copy_tests "$trial/run"
    failed=0
    (cd "$trial/run" && EVS_INSTALLED_IN="$trial/site" PYTHONPATH="$trial/site" MUJOCO_GL=disable \
        emulated -m pytest -q -p no:cacheprovider tests) || failed=$?
    rm -rf "$trial"
    [ "$failed" -eq 0 ] || return "$failed"
    say "$wheel has the golden bytes on $(emulated --version) in an emulator"
}

# Apple's compiler is not here: zig, which has the headers and the list of symbols of macOS, compiles and
# links the module of the wheel for 3.12 and later
macos() {
    mac=$home/macos
    python=$(find_python 3.12)
    [ -n "$python" ] || missing "no Python 3.12 to link a module for"
    environment=$(builder 3.12 "$python")
    PATH="$environment/bin:$PATH" EVS_ZIG="$home/tools/bin/python" "$environment/bin/cmake" -S emulator/core \
        -B "$mac" -G Ninja --log-level=WARNING -DCMAKE_TOOLCHAIN_FILE="$checkout/.ci/macos.cmake" \
        -DPython_EXECUTABLE="$environment/bin/python" -DSKBUILD_SABI_VERSION=3.12 -DEVS_WERROR=ON >/dev/null
    "$environment/bin/ninja" -C "$mac" --quiet
    "$home/tools/bin/python" .ci/audit_macho.py "$mac/_core.abi3.so" \
        "$("$environment/bin/python" -m nanobind --cmake_dir)/darwin-ld-cpython.sym" >&2
    "$home/tools/bin/abi3audit" --strict --summary --assume-minimum-abi3 3.12 "$mac/_core.abi3.so" >&2
    say "macOS on Apple silicon: the core compiles and links"
}

[ $# -gt 0 ] || set -- native aarch64 macos
sh .ci/setup.sh dev
.venv/bin/python .ci/requirements.py --alone wheels >"$home/tools.txt"
if ! cat "$home/tools.txt" .ci/constraints.txt | cmp -s - "$home/tools/made-of"; then
    rm -rf "$home/tools"
    .venv/bin/python -m venv "$home/tools"
    pip "$home/tools" -r "$home/tools.txt"
    cat "$home/tools.txt" .ci/constraints.txt >"$home/tools/made-of"
fi
for target in "$@"; do
    case $target in
    native) native all ;;
    one) native one ;;
    aarch64 | macos) "$target" ;;
    *) missing "no target '$target': native, aarch64, macos or one" ;;
    esac
done
