/* Rays to points of lamps with a size, that are made, traced and added up on the way (lamp_points.py). */
#include "../rays/packets.h"
#include "lamp_points.h"
#include "lifts.h"

/* Adds what got through of the rays of a packet to the pairs that they belong to. */
static void add_free(const Field *f, Packet *rays, const f64 *weight, f64 *clear) {
    i64 count = rays->count;
    u32 found = free_rays(f, rays);
    for (i64 k = 0; k < count; k++)
        if (found >> k & 1) clear[rays->to[k]] += weight[k];
}

/* Where the ray to a point starts from a receiver that may be lifted (terminator_starts). */
static void lifted_start(const Field *f, const f64 *P, const f64 *N, const f64 *point, int directional, const f64 *above,
                         const f64 *side, f64 cutoff, f32 *start) {
    f64 way[3], from[3], share = 0.0;
    for (int j = 0; j < 3; j++) way[j] = point[j] - (directional ? 0.0 : P[j]);
    if (cutoff != 0.0) share = lift_share(cutoff, way, N, side);
    for (int j = 0; j < 3; j++) from[j] = share > 0.0 ? P[j] + share * above[j] : P[j];
    start_of(f->centre, f->scale, f->reach, from, N, start);
}

/* lamp_points of the pairs `part`, what is between them and P, and lamp_sums: what points first..first+count give, added to
   `clear` and `whole` of each. Rays go to points above the horizon only; returns how many. C is 1. N: the surfaces' normals; up: those above
   which points count. above, side, cutoff: of receivers that are lifted, as `terminator.Lift`; None: none is. */
KERNEL(lamp_rays,
       "function u64  wide i64  scene u64  centre f64[3]  scale f64  reach f64  first i64  count i64  P f64[m,3]  N f64[m,3]  up f64[m,3]  "
       "turn f64[m,2]  share i64[m]?  sharers i64  common i64  row i32[k]  light i32[k]  part i32[p]  position f64[L,3]  "
       "directional bool[L]  shape u8[L]  size f64[L]  u f64[L,3]  v f64[L,3]  own u64[L]  facing f64[L,3]  "
       "above f64[m,3]?  side f64[m,3]?  cutoff f64[m]?  clear f64[k,C]!  whole f64[k]!"
       ";  0<=first  0<sharers  0<=row<m  0<=light<L  0<=part<k")
i64 lamp_rays(i64 m, i64 k, i64 p, i64 L, i64 C, u64 function, i64 wide, u64 scene, const f64 *centre, f64 scale, f64 reach, i64 first,
              i64 count, const f64 *P, const f64 *N, const f64 *up, const f64 *turn, const i64 *share, i64 sharers, i64 common,
              const i32 *row, const i32 *light, const i32 *some, const f64 *position, const u8 *directional,
              const u8 *shape, const f64 *size, const f64 *u, const f64 *v, const u64 *own, const f64 *facing,
              const f64 *above, const f64 *side, const f64 *cutoff, f64 *clear, f64 *whole) {
    Field field = {(Occluded)(uintptr_t)function, (void *)(uintptr_t)scene, wide, centre, scale, reach};
    Lamps lamps = {position, directional, shape, size, u, v, own};
    Patterns by = {turn, share, sharers, common};
    Packet rays;
    f64 weight[WIDEST];
    i64 total = 0;
    (void)m, (void)k, (void)L;
    if (wide > WIDEST || C != 1) return 0;
    if (above && !(side && cutoff)) return OUTSIDE;
    empty_packet(&rays, wide);
    for (i64 s = 0; s < p; s++) {
        i64 at = some[s], i = light[at];
        const f64 *from = P + 3 * (i64)row[at], *normal = N + 3 * (i64)row[at];
        Face face = face_of(&lamps, i, from, &by, row[at]);
        f32 start[3];
        start_of(centre, scale, reach, from, normal, start);
        for (i64 q = first; q < first + count; q++) {
            f64 point[3], end[3];
            point_of(&face, q, point);
            f64 gives = point_gives(point, directional[i], shape[i], facing + 3 * i, from, up + 3 * (i64)row[at]);
            if (!(gives > 0.0)) continue;
            whole[at] += gives, weight[rays.count] = gives, total++;
            if (above) lifted_start(&field, from, normal, point, directional[i], above + 3 * (i64)row[at],
                                    side + 3 * (i64)row[at], cutoff[row[at]], start);
            end_of(centre, scale, point, directional[i], end);
            if (add_ray(&field, &rays, start, end, directional[i], 0, 0, at)) add_free(&field, &rays, weight, clear);
        }
    }
    if (rays.count) add_free(&field, &rays, weight, clear);
    return total;
}
