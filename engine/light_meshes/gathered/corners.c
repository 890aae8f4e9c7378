/* Corners of small triangles that meet in a vertex with about the same normal, as one each (grids.py). */
#include "../rays/triangles.h"

/* What is known of corners that are one: c of them so far. `first` was met first, and `sum` is of the ways to the middles
   of their triangles; level: all these lie in one plane. */
typedef struct {
    i32 *slots, *vertex, *turn;
    i64 m, c;
} Classes;

/* The number of the corners at a vertex whose normals are `turn` in steps; *c grows where it is new. */
static i64 class_of(Classes *s, i32 vertex, i32 turn) {
    u64 mask = (u64)s->m - 1, at = ((u64)vertex * SPREAD ^ (u64)turn * SPREAD_2);
    for (at = (at ^ at >> 29) & mask;; at = (at + 1) & mask) {
        i64 of = s->slots[at];
        if (of >= 0 && s->vertex[of] == vertex && s->turn[of] == turn) return of;
        if (of >= 0) continue;
        s->slots[at] = (i32)s->c, s->vertex[s->c] = vertex, s->turn[s->c] = turn;
        return s->c++;
    }
}

/* The shading normal of a corner, turned by a matrix; the triangle's own where it cannot be used. */
static void shading_normal(const f64 *matrix, const f64 *local, const f64 *own, f64 *N) {
    for (int j = 0; j < 3; j++) N[j] = dot(matrix + 3 * j, local);
    f64 length = sqrt(dot(N, N));
    if (length > 0.0 && isfinite(length) && dot(N, own) > 0.3 * length)
        for (int j = 0; j < 3; j++) N[j] /= length;
    else memcpy(N, own, 3 * sizeof *N);
}

/* Gives the corners (n,3) of triangles `small` numbers, and fills for each number where that is, its normal, the longest
   edge around it, and its instance. Returns how many there are. local: the shading normals at the corners, before they
   are turned by `matrix`, of an instance. steps: of a normal's coordinates, within which normals are the same. inset: by
   how much corners within a plane move into their triangles. slots: −1; vertex, turn, sum, level: room. */
KERNEL(grids_corners,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  flipped bool[T]  longest f32[T]  instance i32[T]  "
       "matrix f64[I,3,3]  local f64[n,3,3]  small i32[n]  steps f64  inset f64  slots i32[m]!  vertex i32[k]!  turn i32[k]!  "
       "sum f64[k,4]!  level bool[k]!  number i32[n,3]!  P f64[k,3]!  N f64[k,3]!  spacing f64[k]!  own i32[k]!"
       ";  power(m)  3*n<m  3*n<=k  0<=small<T;  0<=triangles<V  0<=instance<I")
i64 grids_corners(i64 V, i64 T, i64 I, i64 n, i64 m, i64 k, const f64 *centre, f64 scale, const f32 *vertices,
                  const i32 *triangles, const u8 *flipped, const f32 *longest, const i32 *instance, const f64 *matrix,
                  const f64 *local, const i32 *small, f64 steps, f64 inset, i32 *slots, i32 *vertex, i32 *turn, f64 *sum,
                  u8 *level, i32 *number, f64 *P, f64 *N, f64 *spacing, i32 *own) {
    Classes s = {slots, vertex, turn, m, 0};
    (void)V, (void)T, (void)I, (void)k;
    for (i64 i = 0; i < n; i++) {
        i64 t = small[i];
        Edges e = edges_of(vertices, triangles + 3 * t);
        f64 facet[3], normal[3], place[3][3], middle[3];
        cross(e.e, e.f, facet);
        f64 length = sqrt(dot(facet, facet)) * (flipped[t] ? -1.0 : 1.0);
        for (int j = 0; j < 3; j++) {
            facet[j] = length != 0.0 ? facet[j] / length : 0.0;
            for (int c = 0; c < 3; c++)
                place[c][j] = scale * vertices[3 * (i64)triangles[3 * t + c] + j] + centre[j];
            middle[j] = (place[0][j] + place[1][j] + place[2][j]) / 3.0;
        }
        for (int c = 0; c < 3; c++) {
            i64 before = s.c;
            i32 turned = 0;
            shading_normal(matrix + 9 * (i64)instance[t], local + 9 * i + 3 * c, facet, normal);
            for (int j = 0; j < 3; j++) turned = turned * 1024 + (i32)(rint(normal[j] * steps) + steps);
            i64 of = number[3 * i + c] = (i32)class_of(&s, triangles[3 * t + c], turned);
            if (of == before) {
                for (int j = 0; j < 3; j++) {
                    P[3 * of + j] = place[c][j] + inset / 3.0 * (middle[j] - place[c][j]);
                    N[3 * of + j] = normal[j], sum[4 * of + j] = 0.0;
                }
                sum[4 * of + 3] = 0.0, level[of] = 1, spacing[of] = 0.0, own[of] = instance[t];
            }
            for (int j = 0; j < 3; j++) {
                sum[4 * of + j] += middle[j] - place[c][j];
                if (fabs(facet[j] - N[3 * of + j]) > 1e-3) level[of] = 0;
            }
            sum[4 * of + 3] += 1.0;
            if (longest[t] > spacing[of]) spacing[of] = longest[t];
        }
    }
    for (i64 of = 0; of < s.c; of++)
        for (int j = 0; j < 3; j++) {
            /* only corners within a plane move: elsewhere they would move into the surface */
            if (level[of]) P[3 * of + j] += inset * sum[4 * of + j] / sum[4 * of + 3];
            else P[3 * of + j] = scale * vertices[3 * (i64)vertex[of] + j] + centre[j];
        }
    return s.c;
}
