#!/bin/sh
# Run every Python block of docs/howto/learners.md and CleanRL's PPO, in an environment with PyTorch and the libraries
# that the page names (3 GB).
#
#   sh .ci/learners.sh          as they stand on the page
#   sh .ci/learners.sh short    with fewer steps of reinforcement learning: what CI runs
#   sh .ci/learners.sh cleanrl  CleanRL's PPO alone
#   sh .ci/learners.sh install  the environment alone
#   sh .ci/learners.sh curve    train for 200,000 steps and draw docs/img/learning_curve.png
set -eu
cd "$(dirname "$0")/.."
checkout=$PWD
place=build/learners
[ -x .venv/bin/uv ] || sh .ci/setup.sh dev
if [ ! -f $place/env/installed ] || [ ! -d $place/cleanrl ]; then
    .venv/bin/python -m venv --clear --without-pip $place/env
    # shellcheck disable=SC2046 # a list of requirements
    .venv/bin/uv pip install -q --python $place/env/bin/python torch==2.15.0 tonic==1.7.0 snntorch==1.0.0 \
        spikingjelly==2.0.0 stable-baselines3==2.9.2 torchrl==0.14.1 \
        $(.venv/bin/python .ci/requirements.py gym)
    # its file alone: what it asks for is older
    .venv/bin/python -m pip install -q --no-compile --disable-pip-version-check --no-deps --ignore-requires-python \
        --target $place/cleanrl cleanrl==1.2.0
    touch $place/env/installed
fi
mkdir -p $place/run

# in_environment FILE OPTION...
in_environment() {
    (cd $place/run && PYTHONPATH=$checkout/build/ns ../env/bin/python "$@")
}

# cleanrl STEPS: its network is too small for two threads
cleanrl() {
    OMP_NUM_THREADS=1 in_environment "$checkout/.ci/cleanrl.py" ../cleanrl/cleanrl/ppo_continuous_action.py \
        --num-envs 16 --num-steps 128 --total-timesteps "$1" --cuda False
}

case "${1:-}" in
install) exit ;;
curve) in_environment "$checkout/.ci/learning_curve.py" "$checkout/docs/img/learning_curve.png"; exit ;;
cleanrl) cleanrl 20480; exit ;;
esac
.venv/bin/python - docs/howto/learners.md > $place/run/learners.py <<'END'
import re, sys
print("\n".join(re.findall(r"^```python\n(.*?)^```", open(sys.argv[1]).read(), re.DOTALL | re.MULTILINE)))
END
[ "${1:-}" != short ] || sed -i 's/learn(40_000)/learn(4_000)/' $place/run/learners.py
in_environment learners.py
cleanrl "$([ "${1:-}" = short ] && echo 10240 || echo 20480)"
