#!/bin/sh
# Run every Python block of docs/howto/learners.md, in an environment with PyTorch and the libraries that it names (3 GB).
#
#   sh .ci/learners.sh          as they stand on the page
#   sh .ci/learners.sh short    with fewer steps of reinforcement learning: what CI runs
set -eu
cd "$(dirname "$0")/.."
checkout=$PWD
place=build/learners
if [ ! -f $place/installed ]; then
    .venv/bin/python -m venv $place
    # shellcheck disable=SC2046 # a list of requirements
    $place/bin/python -m pip install -q --no-compile --disable-pip-version-check torch==2.15.0 tonic==1.7.0 snntorch==1.0.0 \
        spikingjelly==2.0.0 stable-baselines3==2.9.2 torchrl==0.14.1 \
        $(.venv/bin/python .ci/requirements.py gym)
    touch $place/installed
fi
mkdir -p $place/run
.venv/bin/python - docs/howto/learners.md > $place/run/learners.py <<'END'
import re, sys
print("\n".join(re.findall(r"^```python\n(.*?)^```", open(sys.argv[1]).read(), re.DOTALL | re.MULTILINE)))
END
[ "${1:-}" != short ] || sed -i 's/learn(40_000)/learn(4_000)/' $place/run/learners.py
cd $place/run && PYTHONPATH=$checkout/build/ns exec ../bin/python learners.py
