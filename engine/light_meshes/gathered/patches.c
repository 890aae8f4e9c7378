/* Which patches rays meet, and the light that patches gather from other patches (patches.py). */
#include "grids.h"
#include "table.h"

/* Fills what each patch gathers: its links begin..begin+count, each to a patch whose light has a row in `light`. weight:
   of each link, None: all count `even`. A link to −1 has no light. */
KERNEL(patches_gather,
       "begin i64[n]  count i64[n]  other i32[q]  weight f32[q,3]?  even f64  light f64[m,3]  out f64[n,3]!"
       ";  other<m")
i64 patches_gather(i64 n, i64 q, i64 m, const i64 *begin, const i64 *count, const i32 *other, const f32 *weight,
                   f64 even, const f64 *light, f64 *out) {
    (void)m;
    for (i64 k = 0; k < n; k++) {
        f64 sum[3] = {0};
        if (begin[k] < 0 || count[k] > q || begin[k] > q - count[k]) return OUTSIDE;
        for (i64 i = begin[k]; i < begin[k] + count[k]; i++) {
            if (other[i] < 0) continue;
            const f64 *L = light + 3 * (i64)other[i];
            for (int j = 0; j < 3; j++) sum[j] += weight ? weight[3 * i + j] * L[j] : L[j];
        }
        for (int j = 0; j < 3; j++) out[3 * k + j] = even * sum[j];
    }
    return 0;
}

/* Fills the keys of the patches of about size[k] at places P[k] of triangles, on the side that `direction` comes from,
   and the barycentrics of these places. for_small: as `rays.Gatherer.for_small`, of patches from `finest` on. */
KERNEL(patches_at,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  for_small i32[s,T]  "
       "finest f64  triangle i32[n]  P f64[n,3]  direction f64[n,3]  size f64[n]  keys u64[n]!  u f32[n]!  v f32[n]!"
       ";  1<=s  0<finest<inf  0<=triangle<T;  0<=triangles<V  -1<=other<T  -1<=for_small<T")
i64 patches_at(i64 V, i64 T, i64 s, i64 n, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
               const i32 *other, const u8 *flipped, const i32 *for_small, f64 finest, const i32 *triangle, const f64 *P,
               const f64 *direction, const f64 *size, u64 *keys, f32 *u, f32 *v) {
    (void)V;
    for (i64 k = 0; k < n; k++) {
        i64 t = triangle[k], level = s, i, j;
        f64 normal[3], place[3], q[3], a[3], b[3], xy[2], edge = finest;
        Edges e = edges_of(vertices, triangles + 3 * t);
        for (int c = 0; c < 3; c++) place[c] = (P[3 * k + c] - centre[c]) / scale, q[c] = place[c] - e.a[c];
        cross(e.e, e.f, normal), cross(q, e.f, a), cross(e.e, q, b);
        f64 area = dot(normal, normal);
        u[k] = area > 0.0 ? (f32)(dot(a, normal) / area) : 0.0f, v[k] = area > 0.0 ? (f32)(dot(b, normal) / area) : 0.0f;
        int front = (dot(normal, direction + 3 * k) < 0.0) != flipped[t];
        while (level > 1 && 2.0 * edge <= size[k]) edge *= 2.0, level--;
        while (level < 15 && edge > size[k]) edge *= 0.5, level++;
        i64 step = level < s ? s - level : 0, small = for_small[step * T + t];
        if (small >= 0) {
            keys[k] = key_at(small, front, 0, step, 0);
            continue;
        }
        Grid g = grid_of(vertices, triangles, other, scale, t, edge);
        on_axes(&g.axes, place, xy), cell_of(&g, xy, &i, &j);
        keys[k] = key_at(g.lead, front, (int)level, i, j);
    }
    return 0;
}

/* Fills the numbers of the patches that rays met at barycentrics u, v of triangles: of cells with these keys, or, where
   one is divided, of the smaller one there. Keys above `last` get −1 and less. todo: rows that are not done, from
   state[0] to state[2]; those whose patches are not known are put at its begin, and state[1] counts them. Returns 1
   where the table has no room: call it again with a larger one. */
KERNEL(patches_met,
       "scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  top f64  last u64  known bool[p]  divided bool[p]  "
       "slots i32[s]!  entered u64[q]!  size i64[1]!  keys u64[x]  triangle i32[x]  u f32[x]  v f32[x]  todo i32[x]!  "
       "state i64[3]!  number i32[x]!"
       ";  power(s)  q<s  0<=size<=q  0<top<inf  0<=state;  0<=triangles<V  -1<=other<T  -1<=triangle<T")
i64 patches_met(i64 V, i64 T, i64 p, i64 s, i64 q, i64 x, f64 scale, const f32 *vertices, const i32 *triangles,
                const i32 *other, f64 top, u64 last, const u8 *known, const u8 *divided, i32 *slots, u64 *entered,
                i64 *size, const u64 *keys, const i32 *triangle, const f32 *u, const f32 *v, i32 *todo, i64 *state,
                i32 *number) {
    Slots table = {slots, entered, size, s, q};
    (void)V;
    if (state[2] > x || state[1] > state[0]) return OUTSIDE;
    for (; state[0] < state[2]; state[0]++) {
        i64 k = todo[state[0]], of;
        if (k < 0 || k >= x) return OUTSIDE;
        u64 key = keys[k];
        f64 xy[2];
        int placed = 0;
        if (key > last) {
            number[k] = -(i32)(~key) - 1;
            continue;
        }
        while (1) {
            if ((of = number_of(&table, key)) < 0) return 1;
            if (of >= p || !known[of] || !divided[of]) break;
            Key cell = key_of(key);
            i64 i, j;
            if (cell.triangle >= T || triangle[k] < 0) return OUTSIDE;
            Grid g = grid_of(vertices, triangles, other, scale, cell.triangle, ldexp(top, -cell.level));
            if (!placed) {
                Axes axes = axes_of(vertices, triangles, other, scale, triangle[k]);
                Edges e = edges_of(vertices, triangles + 3 * (i64)triangle[k]);
                f64 place[3];
                for (int c = 0; c < 3; c++) place[c] = e.a[c] + (f64)u[k] * e.e[c] + (f64)v[k] * e.f[c];
                on_axes(&axes, place, xy), placed = 1;
            }
            cell_of(&g, xy, &i, &j);
            key = key_at(cell.triangle, cell.front, cell.level + 1, i, j);
        }
        number[k] = (i32)of;
        if (of >= p || !known[of]) todo[state[1]++] = (i32)k;
    }
    return 0;
}

/* Fills each of these numbers (those below 0 are none) once that is not known, and returns how many there are. seen: not
   set before and after. */
KERNEL(patches_missing, "number i32[n]  known bool[p]  seen bool[p]!  missing i32[n]!"
       ";  number<p")
i64 patches_missing(i64 n, i64 p, const i32 *number, const u8 *known, u8 *seen, i32 *missing) {
    i64 count = 0;
    (void)p;
    for (i64 k = 0; k < n; k++) {
        i64 of = number[k];
        if (of < 0 || known[of] || seen[of]) continue;
        seen[of] = 1, missing[count++] = (i32)of;
    }
    for (i64 k = 0; k < count; k++) seen[missing[k]] = 0;
    return count;
}
