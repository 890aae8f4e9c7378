#!/bin/sh
# Runs the engine's tests with kernels that stop at every read or write outside an array, and at undefined behaviour.
# Needs gcc. From the checkout's root: sh tests/support/sanitize.sh [pytest's arguments]
# Without arguments it runs tests that call every kernel, which takes some 20 minutes. In the end it names all kernels
# that were not called: a new one, or a new C file, is not forgotten. The exit code is 1 if a test failed or a kernel
# was not called.
# Not for test_fuzz.py, whose fuzzer brings a sanitizer of its own, nor for test_memory.py, which would count this one's.
set -eu
library=engine/light_meshes/kernels-sanitized.so
objects=$(mktemp -d)
trap 'rm -rf "$library" "$objects"' EXIT
digest=$(.venv/bin/python -c '
from pathlib import Path
from light_meshes.support.sources import digest
print(digest(Path("engine/light_meshes").resolve()))')
sanitizers="-fsanitize=address,undefined --coverage"
for source in $(find engine/light_meshes -name '*.c'); do
  object=$objects/$(echo "$source" | tr / + | sed 's/c$/o/')
  # shellcheck disable=SC2086
  gcc -c -fPIC -g -O1 -std=gnu11 -ffp-contract=off -fno-omit-frame-pointer $sanitizers -fno-sanitize-recover=all \
    -fprofile-update=atomic -fvisibility=hidden -Iengine/light_meshes/support -DSOURCES="\"$digest\"" \
    -o "$object" "$source"
done
# shellcheck disable=SC2086
gcc -shared $sanitizers -o "$library" "$objects"/*.o -lm
