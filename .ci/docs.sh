#!/bin/sh
# Build the site into build/docs, with every warning an error; run by `make docs` and `make check`.
set -eu
cd "$(dirname "$0")/.."
sh .ci/setup.sh docs
.venv/bin/python -m sphinx -q -W --keep-going -b html -c docs . build/docs
echo "evs: the site is in build/docs: open build/docs/docs/index.html" >&2
