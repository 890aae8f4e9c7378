/* Finds the bodies around a light (optics.py). */
#include <stdlib.h>

#include "optics.h"

/* Fills around: the bodies that a ray from the light leaves more often than it enters. Returns 1 if there is not
   enough memory. */
KERNEL(optics_medium_at, GLASS "light f64[3]  around i64[c,2]!  work i64[5]!"
       ";  c=65;  -1<=planar<m  tree(child,m)")
i64 optics_medium_at(i64 m, i64 y, i64 b, i64 d, i64 c, OF_GLASS, const f64 *light, i64 *around, i64 *work) {
    Glass g = {m, b, place, link, planar, patch_size, ior, rank, ball, box, child};
    i64 *balance = calloc((size_t)(b ? b : 1), sizeof *balance);
    f64 t0 = 0.0, last = -1.0;
    i64 last_body = -1, last_facing = 0, skip = 0, skips = 0;
    Ray ray = {{0}};
    Hit hit = {0};
    (void)y, (void)d, (void)c;
    if (!balance) return 1;
    for (int j = 0; j < 3; j++) {
        static const f64 along[3] = {2.0, 3.0, 5.0};  /* a direction that lies in no plane that an artist builds */
        ray[0][j] = light[j], ray[1][j] = sqrt(along[j] / 10.0);
    }
    for (;;) {
        work[RAYS]++;
        i64 slot = closest(&g, ray, t0, INFINITY, &skip, skips, -1, 0.0, &hit);
        if (slot < 0) break;
        t0 = hit.t, skip = slot, skips = 1;
        i64 body = link_of(&g, slot, BODY), facing = slope_of(place_of(&g, slot), ray) > 0.0 ? 1 : -1;
        if (body >= 0 && !(body == last_body && facing == last_facing && t0 - last < TOUCHING)) balance[body] += facing;
        last = t0, last_body = body, last_facing = facing;
    }
    for (i64 k = 0; k < b; k++)
        if (balance[k] > 0 && around[0] < BODIES) {
            i64 row = ++around[0];
            around[2 * row] = k, around[2 * row + 1] = balance[k];
        }
    free(balance);
    return 0;
}
