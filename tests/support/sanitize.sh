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
from_sources() { .venv/bin/python -c "
import sys
from pathlib import Path
from light_meshes.support.declarations import calls
from light_meshes.support.sources import digest, included
package = Path('engine/light_meshes').resolve()
print($1)"; }
flags="-std=gnu11 -Iengine/light_meshes/support"
# Coverage tells which kernels were called.
sanitizers="-fsanitize=address,undefined --coverage"
# shellcheck disable=SC2086
from_sources 'included(package)' | gcc $flags -w -E -x c - | from_sources 'calls(sys.stdin.read())' > "$objects/slots.c"
digest=$(from_sources 'digest(package)')
for source in $(find engine/light_meshes -name '*.c') "$objects/slots.c"; do
  object=$objects/$(echo "$source" | tr / + | sed 's/c$/o/')
  # shellcheck disable=SC2086
  gcc -c -fPIC -g -O1 $flags -Wno-psabi -ffp-contract=off -fno-omit-frame-pointer $sanitizers -fno-sanitize-recover=all \
    -fprofile-update=atomic -fvisibility=hidden -DSOURCES="\"$digest\"" -o "$object" "$source"
done
# shellcheck disable=SC2086
gcc -shared $sanitizers -o "$library" "$objects"/*.o -lm
all=""
if [ $# = 0 ]; then
  all=yes
  for name in attributes blurred border broken_scenes facets film glass_in_glass layers light_threshold native node_store \
    patched procedural psi refraction reuse rows same_picture semitransparent shadow_rate sheets_in_one_place \
    sized_glass sized_toggles terminator textures worlds; do
    set -- "$@" "tests/engine/test_$name.py"
  done
  set -- "$@" tests/engine/test_bench.py::test_a_lock_that_is_held_is_told_from_one_that_is_not -m "not slow" \
    -n 2 --dist loadfile
fi
export LIGHT_MESHES_KERNELS=kernels-sanitized ASAN_OPTIONS=detect_leaks=0
failed=0
LD_PRELOAD="$(gcc -print-file-name=libasan.so) $(gcc -print-file-name=libubsan.so)" \
  .venv/bin/python -m pytest -q -p no:cacheprovider "$@" || failed=1
# The kernels that the library declares, and of these the ones of which no line was run.
nm -D --defined-only "$library" | sed -n 's/.* \(.*\)_takes$/\1/p' | sort > "$objects/kernels"
(cd "$objects" && gcov -n -f ./*.gcno 2>&1) | tr -d "'" \
  | awk '/^Function / {name = $2} /^Lines executed:0.00%/ {print name}' | sort > "$objects/idle"
left=$(comm -12 "$objects/kernels" "$objects/idle" | paste -sd ' ')
echo "kernels that no test called: ${left:-none}"
[ -z "$all" ] || [ -z "$left" ] || failed=1
exit $failed
