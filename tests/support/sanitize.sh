#!/bin/sh
# Runs the engine's tests with kernels that stop at every read or write outside an array, and at undefined behaviour.
# Needs gcc. From the checkout's root: sh tests/support/sanitize.sh [pytest's arguments]
# Without arguments it runs short tests that together call every kernel, in one process, which takes some ten minutes.
# In the end it names all kernels that were not called: a new one, or a new C file, is not forgotten. The exit code is 1
# if a test failed or a kernel was not called. What a process that is killed has called is not counted.
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
  # Short files that call most kernels, and for each of the others one short test.
  for name in attributes border broken_scenes lamp_programs layers native procedural rows semitransparent \
    sheets_in_one_place straight_light terminator textures tiles worlds; do
    set -- "$@" "tests/engine/test_$name.py"
  done
  for name in bench.py::test_a_lock_that_is_held_is_told_from_one_that_is_not \
    blocks.py::test_lamps_that_all_see_cost_half_a_ray_or_less blocks.py::test_planes_do_not_speak_for_each_other \
    blurred.py::test_in_a_white_world_nothing_is_seen blurred.py::test_rough_glass_passes_what_clear_glass_passes \
    clusters.py::test_light_without_shadows_is_within_the_bound everywhere.py::test_a_furnace_of_small_triangles \
    everywhere.py::test_nothing_is_gathered_on_what_is_cut_out everywhere.py::test_parts_of_the_light_add_up \
    everywhere.py::test_wider_patches_of_all_sizes_are_patches \
    glass_shadows.py::test_what_bends_no_light_lets_it_through_as_before \
    lamps_with_a_size.py::test_a_straight_edge_has_the_profile_of_a_disc \
    lamps_with_a_size.py::test_sharp_casters_shadow_sharply light_threshold.py::test_the_error_is_below_the_bound \
    lights.py::test_pairs_are_listed_in_parts \
    node_store.py refraction.py::test_light_at_the_centre_of_a_sphere_is_not_bent \
    reuse.py::test_a_moved_object_drops_what_looked_past_it sized_highlights.py::test_a_window_mirrored_beside_a_wall \
    sized_toggles.py::test_a_lamp_lights_what_it_is_linked_to \
    sized_toggles.py::test_each_point_of_a_lamp_counts_by_the_glass_on_its_way; do
    set -- "$@" "tests/engine/test_$name"
  done
  set -- "$@" -m "not slow"
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
