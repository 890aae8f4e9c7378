#!/bin/sh
# Runs the engine's tests with kernels that stop at every read or write outside an array, and at undefined behaviour.
# Needs gcc. From the checkout's root: sh tests/support/sanitize.sh [pytest's arguments]
# Not for test_fuzz.py, whose fuzzer brings a sanitizer of its own, nor for test_memory.py, which would count this one's.
set -eu
library=engine/light_meshes/kernels-sanitized.so
slots=$(mktemp --suffix .c)
trap 'rm -f "$library" "$slots"' EXIT
flags="-std=gnu11 -Iengine/light_meshes/support"
from_sources() { .venv/bin/python -c "
import sys
from pathlib import Path
from light_meshes.support.sources import calls, digest, included
package = Path('engine/light_meshes').resolve()
print($1)"; }
# shellcheck disable=SC2086
from_sources 'included(package)' | gcc $flags -w -E -x c - | from_sources 'calls(sys.stdin.read())' > "$slots"
# shellcheck disable=SC2046,SC2086
gcc -shared -fPIC -g -O1 $flags -ffp-contract=off -fno-omit-frame-pointer -fsanitize=address,undefined \
  -fno-sanitize-recover=all -fvisibility=hidden -DSOURCES="\"$(from_sources 'digest(package)')\"" \
  -o "$library" $(find engine/light_meshes -name '*.c') "$slots" -lm
[ $# -gt 0 ] || set -- tests/engine/test_native.py tests/engine/test_psi.py tests/engine/test_node_store.py tests/engine/test_same_picture.py \
  tests/engine/test_refraction.py tests/engine/test_terminator.py tests/engine/test_broken_scenes.py
export LIGHT_MESHES_KERNELS=kernels-sanitized ASAN_OPTIONS=detect_leaks=0
LD_PRELOAD="$(gcc -print-file-name=libasan.so) $(gcc -print-file-name=libubsan.so)" \
  .venv/bin/python -m pytest -q -p no:cacheprovider "$@"
