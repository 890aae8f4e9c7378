/* The light that patches gather from other patches (patches.py). */
#include "grids.h"

/* Fills what each patch gathers: its links begin..begin+count, each to a patch whose light has a row in `light`. weight:
   of each link, None: all count `even`. */
KERNEL(patches_gather,
       "begin i64[n]  count i64[n]  other i32[q]  weight f32[q,3]?  even f64  light f64[m,3]  out f64[n,3]!")
i64 patches_gather(i64 n, i64 q, i64 m, const i64 *begin, const i64 *count, const i32 *other, const f32 *weight,
                   f64 even, const f64 *light, f64 *out) {
    (void)q, (void)m;
    for (i64 k = 0; k < n; k++) {
        f64 sum[3] = {0};
        for (i64 i = begin[k]; i < begin[k] + count[k]; i++) {
            const f64 *L = light + 3 * (i64)other[i];
            for (int j = 0; j < 3; j++) sum[j] += weight ? weight[3 * i + j] * L[j] : L[j];
        }
        for (int j = 0; j < 3; j++) out[3 * k + j] = even * sum[j];
    }
    return 0;
}

/* Fills the keys of the patches of about size[k] at places P[k] of triangles, on the side that `direction` comes from,
   and where on the axes of its grid each place is. top: the size of patches of level 1; for_small: as
   `rays.Gatherer.for_small`, of patches from `finest` on. */
KERNEL(patches_at,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  for_small i32[s,T]  "
       "finest f64  triangle i32[n]  P f64[n,3]  direction f64[n,3]  size f64[n]  keys u64[n]!  on f32[n,2]!")
i64 patches_at(i64 V, i64 T, i64 s, i64 n, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
               const i32 *other, const u8 *flipped, const i32 *for_small, f64 finest, const i32 *triangle, const f64 *P,
               const f64 *direction, const f64 *size, u64 *keys, f32 *on) {
    (void)V;
    for (i64 k = 0; k < n; k++) {
        i64 t = triangle[k], level = s, i, j;
        f64 normal[3], place[3], xy[2], edge = finest;
        Edges e = edges_of(vertices, triangles + 3 * t);
        cross(e.e, e.f, normal);
        int front = (dot(normal, direction + 3 * k) < 0.0) != flipped[t];
        while (level > 1 && 2.0 * edge <= size[k]) edge *= 2.0, level--;
        while (level < 15 && edge > size[k]) edge *= 0.5, level++;
        i64 small = for_small[(level < s ? s - level : 0) * T + t];
        on[2 * k] = on[2 * k + 1] = 0;
        if (small >= 0) {
            keys[k] = key_at(small, front, 0, 0, 0);
            continue;
        }
        for (int c = 0; c < 3; c++) place[c] = (P[3 * k + c] - centre[c]) / scale;
        Grid g = grid_of(vertices, triangles, other, scale, t, edge);
        on_axes(&g.axes, place, xy), cell_of(&g, xy, &i, &j);
        on[2 * k] = (f32)xy[0], on[2 * k + 1] = (f32)xy[1];
        keys[k] = key_at(g.lead, front, (int)level, i, j);
    }
    return 0;
}
