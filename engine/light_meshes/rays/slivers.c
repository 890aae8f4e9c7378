/* Long, thin, slanted triangles (slivers.py). */
#include "native.h"

static f64 least(f64 a, f64 b) { return b < a ? b : a; }
static f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* For each object: adds up the surface of the boxes of its slivers, counts them, and enlarges the object's box low,
   high. A sliver's box has more than `thin` times the surface of its triangle. */
KERNEL(slivers_needless,
       "vertices f32[v,3]  triangles i32[t,3]  owner i32[t]  thin f64  area f64[o]!  count i64[o]!  low f64[o,3]!  "
       "high f64[o,3]!"
       ";  0<=triangles<v  0<=owner<o")
i64 slivers_needless(i64 v, i64 t, i64 o, const f32 *vertices, const i32 *triangles, const i32 *owner, f64 thin,
                     f64 *area, i64 *count, f64 *low, f64 *high) {
    (void)v, (void)o;
    for (i64 k = 0; k < t; k++) {
        const f32 *a = vertices + 3 * (i64)triangles[3 * k], *b = vertices + 3 * (i64)triangles[3 * k + 1];
        const f32 *c = vertices + 3 * (i64)triangles[3 * k + 2];
        f64 e[3], f[3], side[3];
        for (int j = 0; j < 3; j++) {
            e[j] = (f64)b[j] - a[j], f[j] = (f64)c[j] - a[j];
            side[j] = most(most(e[j], f[j]), 0.0) - least(least(e[j], f[j]), 0.0);
        }
        f64 box = 2.0 * (side[0] * side[1] + side[1] * side[2] + side[2] * side[0]);
        f64 x = e[1] * f[2] - e[2] * f[1], y = e[2] * f[0] - e[0] * f[2], z = e[0] * f[1] - e[1] * f[0];
        i64 own = owner[k];
        if (box * box > thin * thin * (x * x + y * y + z * z)) {
            area[own] += box;
            count[own]++;
        }
        for (int j = 0; j < 3; j++) {
            low[3 * own + j] = least(low[3 * own + j], least(a[j], least(b[j], c[j])));
            high[3 * own + j] = most(high[3 * own + j], most(a[j], most(b[j], c[j])));
        }
    }
    return 0;
}
