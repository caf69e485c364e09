#!/bin/sh
# Run every Python block of docs/howto/learners.md, in an environment with PyTorch and the libraries that it names.
set -eu
cd "$(dirname "$0")/.."
checkout=$PWD
place=build/learners
if [ ! -x $place/bin/python ]; then
    .venv/bin/python -m venv $place
    # shellcheck disable=SC2046 # a list of requirements
    $place/bin/python -m pip install -q --disable-pip-version-check torch tonic snntorch spikingjelly stable-baselines3 torchrl \
        $(.venv/bin/python .ci/requirements.py gym)
fi
mkdir -p $place/run
.venv/bin/python - docs/howto/learners.md > $place/run/learners.py <<'END'
import re, sys
print("\n".join(re.findall(r"^```python\n(.*?)^```", open(sys.argv[1]).read(), re.DOTALL | re.MULTILINE)))
END
cd $place/run && PYTHONPATH=$checkout/build/ns exec ../bin/python learners.py
