#!/bin/sh
# Python's C headers for the Python named. Where it has them: prints nothing. Debian keeps them in a
# package of their own (python3-dev): then it is fetched and unpacked into build/headers, which needs
# no root, and the arguments that point CMake there are printed. Else one line and exit code 2.
set -eu
cd "$(dirname "$0")/.."
include=$("$1" -c 'import sysconfig; print(sysconfig.get_path("include"))')
[ ! -f "$include/Python.h" ] || exit 0

version=$("$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
package=libpython$version-dev
unpacked=$(pwd)/build/headers/usr/include
if [ ! -f "$unpacked/python$version/Python.h" ]; then
    mkdir -p build/headers
    if ! (cd build/headers && apt-get download "$package" && dpkg -x "$package"_*.deb .) >/dev/null 2>&1; then
        echo "evs: Python.h of Python $version is missing; on Debian: apt install python3-dev" >&2
        exit 2
    fi
fi
echo "-DPython_INCLUDE_DIR=$unpacked/python$version -DCMAKE_CXX_FLAGS=-isystem$unpacked"
