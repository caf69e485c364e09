#!/bin/sh
# Build the native core for one lane, the code of a thread of a GPU, and run on it, without a GPU, the
# golden digests and the tests that compare instruction sets: renderers, truth, pixels, EvSNet.
set -eu
cd "$(dirname "$0")/.."
place=build/one_lane
if [ ! -f "$place/build.ninja" ]; then
    # shellcheck disable=SC2046 # a list of arguments
    .venv/bin/cmake -S emulator/core -B "$place" -G Ninja --log-level=WARNING \
        -DCMAKE_MAKE_PROGRAM="$(pwd)/.venv/bin/ninja" -DPython_EXECUTABLE="$(pwd)/.venv/bin/python" \
        "-DEVS_ISA=portable;one_lane" -DEVS_WERROR=ON $(sh .ci/headers.sh .venv/bin/python) >/dev/null
fi
.venv/bin/ninja -C "$place" --quiet

# the package of this checkout around that core
package=$(pwd)/$place/evs
rm -rf "$package"
mkdir -p "$package/emulator"
cp "$place/package/"* "$package"
for folder in msgs drivers tools examples launch config; do ln -s "$(pwd)/$folder" "$package/$folder"; done
for file in emulator/*; do
    case $file in
    *.so) ;;
    *) ln -s "$(pwd)/$file" "$package/$file" ;;
    esac
done
cp "$place"/_core.*.so "$package/emulator"
export PYTHONPATH="$(pwd)/$place"
.venv/bin/python -c 'from evs.emulator import _core
assert _core.isa_available() == ["one_lane", "portable"], _core.isa_available()'
# what is traced anew in every tick keeps nothing
.venv/bin/pytest -q -p no:cacheprovider -n auto --maxprocesses 4 --dist load \
    -m "not campaign and not slow" \
    -k "(bytes or film or instruction or digest or choose) and not incremental" \
    tests/emulator/world/test_world_digest.py tests/emulator/render/test_render_digest.py \
    tests/emulator/render/test_render_same_bytes.py tests/emulator/render/test_render_truth.py \
    tests/emulator/render/test_render_hybrid.py tests/emulator/render/test_render_lamps.py \
    tests/emulator/sensor/test_sensor_whole_pixel.py \
    tests/emulator/evsnet/test_evsnet_native_random.py
