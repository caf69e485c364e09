#!/bin/sh
# The MuJoCo and NumPy that people have: an environment a row in build/versions, and in each the
# tests that do not depend on the extras, and an environment of the row's library seen by evs.EventCamera.
# One line a row; rows run side by side. Run by `make check`.
#
#   sh .ci/versions.sh [ROW...]         some rows only
#   sh .ci/versions.sh install [ROW...] the environments alone
set -eu
cd "$(dirname "$0")/.."

# row | what it pins | with pip's --no-deps: only what these tests import of it
ROWS='
metaworld|mujoco==3.3.0 numpy==1.26.4 metaworld==3.1.1|dm_control
robosuite|mujoco==3.8.1 numpy==1.26.4 numba scipy termcolor tqdm opencv-python-headless==4.11.0.86|dm_control robosuite
gymnasium_robotics|mujoco==3.8.1 numpy==2.1.3 gymnasium-robotics==1.4.2|dm_control
dm_control|mujoco==3.17.0 numpy==2.4.6 dm_control==1.0.50|
mujoco_4|mujoco==4.0.0 numpy==1.26.4|dm_control
'
TESTS='
tests/emulator/render/test_render_digest.py
tests/emulator/world/test_world_digest.py
tests/emulator/world/test_world_compat.py
tests/emulator/world/test_world_cameras.py
tests/emulator/world/test_world_extraction.py::test_every_shipped_robot_is_seen_as_mujoco_shows_it
tests/emulator/world/test_world_poses.py
tests/emulator/world/test_scene_values.py
tests/emulator/simulation/test_api_sensor.py
tests/emulator/simulation/test_closed_saved.py
tests/launch/test_doctor_command.py::test_this_machine_is_fit
'
# MuJoCo 3.3 has no sleeping bodies, and shifts the principal point up where 3.5 and later shift down
OLD='not sleeping and not sees_what_mujoco_sees'

# what these tests need in any row. mujoco wants an OpenGL, which pyrender, not here, pins low
COMMON='pytest hypothesis PyOpenGL==3.1.10'

run() {
    row=$1 pinned=$2 bare=$3
    home=build/versions/$row
    mkdir -p "$home"
    grep -v -E '^(mujoco|mujoco-core|mujoco-studio|numpy|opencv-python-headless|PyOpenGL)==' \
        .ci/constraints.txt >"$home/constraints.txt"
    .venv/bin/python .ci/requirements.py gym >"$home/requirements.txt"
    # shellcheck disable=SC2086 # lists of words
    printf '%s\n' $COMMON $pinned >>"$home/requirements.txt"
    { cat "$home/constraints.txt" "$home/requirements.txt" && echo "$bare"; } >"$home/wanted"
    if ! cmp -s "$home/wanted" "$home/installed"; then
        rm -rf "$home/env"
        .venv/bin/python -m venv --without-pip "$home/env"
        pip="$(pwd)/.venv/bin/uv pip install -q --python $home/env/bin/python"
        $pip -c "$home/constraints.txt" -r "$home/requirements.txt"
        # shellcheck disable=SC2086
        [ -z "$bare" ] || $pip --no-deps -c "$home/constraints.txt" $bare
        cp "$home/wanted" "$home/installed"
    fi
    [ -z "$install" ] || return 0
    python=$home/env/bin/python
    $python .ci/link.py

    chosen=''
    case $pinned in *mujoco==3.3.*) chosen=$OLD ;; esac
    library=tests/versions/environments.py::test_$row
    [ "$row" != mujoco_4 ] || library=''
    # dm_control is not to look for a display, numba has nothing to gain from a few steps
    # shellcheck disable=SC2086
    if MUJOCO_GL=disable NUMBA_DISABLE_JIT=1 $python -m pytest -q -p no:cacheprovider -k "$chosen" $TESTS $library \
        >"$home/log" 2>&1; then
        echo "$row: $(echo "$pinned" | cut -d ' ' -f 1,2 | tr '\n' ' ')$(tail -n 1 "$home/log")"
    else
        cat "$home/log"
        echo "$row: $pinned: failed" >&2
        return 1
    fi
}

install=
if [ "${1:-}" = install ]; then install=install && shift; fi
# all rows: this script once for each, as many at a time as there are processors, four at most
if [ $# -eq 0 ]; then
    at_once=$(getconf _NPROCESSORS_ONLN)
    [ "$at_once" -le 4 ] || at_once=4
    echo "$ROWS" | sed -n 's/|.*//p' | xargs -P "$at_once" -I '{}' sh .ci/versions.sh $install '{}'
    exit
fi
failed=0
while IFS='|' read -r row pinned bare; do
    [ -n "$row" ] || continue
    case " $* " in *" $row "*) ;; *) continue ;; esac
    run "$row" "$pinned" "$bare" </dev/null || failed=1
done <<END
$ROWS
END
exit "$failed"
