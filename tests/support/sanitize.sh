#!/bin/sh
# Runs the engine's tests with kernels that stop at every read or write outside an array, and at undefined behaviour.
# Needs gcc. From the checkout's root: sh tests/support/sanitize.sh [pytest's arguments]
# Not for test_fuzz.py, whose fuzzer brings a sanitizer of its own, nor for test_memory.py, which would count this one's.
set -eu
library=engine/light_meshes/kernels-sanitized.so
trap 'rm -f "$library"' EXIT
# shellcheck disable=SC2046
gcc -shared -fPIC -g -O1 -std=gnu11 -ffp-contract=off -fno-omit-frame-pointer -fsanitize=address,undefined \
  -fno-sanitize-recover=all -fvisibility=hidden -Iengine/light_meshes/support \
  -DSOURCES="\"$(.venv/bin/python -c '
from pathlib import Path
from light_meshes.support.sources import digest
print(digest(Path("engine/light_meshes").resolve()))')\"" \
  -o "$library" $(find engine/light_meshes -name '*.c') -lm
[ $# -gt 0 ] || set -- tests/engine/test_native.py tests/engine/test_psi.py tests/engine/test_node_store.py tests/engine/test_same_picture.py \
  tests/engine/test_refraction.py tests/engine/test_terminator.py tests/engine/test_broken_scenes.py
export LIGHT_MESHES_KERNELS=kernels-sanitized ASAN_OPTIONS=detect_leaks=0
LD_PRELOAD="$(gcc -print-file-name=libasan.so) $(gcc -print-file-name=libubsan.so)" \
  .venv/bin/python -m pytest -q -p no:cacheprovider "$@"
