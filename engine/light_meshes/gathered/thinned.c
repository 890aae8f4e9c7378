/* Corners of dense meshes take their light from a few of them that are near (thinned.py). */
#include "leaning.h"
#include "sectors.h"
#include "table.h"

#define BITS 21
#define ALIKE 0.8                   /* the cosine from which on normals are so unlike that a source does not count */
#define LEAN_SINE 0.5               /* of the angle by which normals lean (directions.py) */
#define LEAN_COSINE 0.8660254037844386

static inline u64 packed(const i64 *c) {
    return (u64)(c[0] & 0x1FFFFF) | (u64)(c[1] & 0x1FFFFF) << BITS | (u64)(c[2] & 0x1FFFFF) << 2 * BITS;
}

/* Fills the keys of the cells with this edge in which places P are. */
KERNEL(thinned_cells, "edge f64  P f64[n,3]  keys u64[n]!;  0<edge<inf")
i64 thinned_cells(i64 n, f64 edge, const f64 *P, u64 *keys) {
    for (i64 k = 0; k < n; k++) {
        i64 c[3];
        for (int j = 0; j < 3; j++) c[j] = (i64)floor(P[3 * k + j] / edge);
        keys[k] = packed(c);
    }
    return 0;
}

/* How much a source counts for a corner: less the farther away it is, up to `reach`, and the more its normal differs, or
   it is above or below the corner's plane. */
static inline f64 counts(const f64 *P, const f64 *N, const f64 *Q, const f64 *M, f64 reach) {
    f64 d[3] = {Q[0] - P[0], Q[1] - P[1], Q[2] - P[2]}, alike = (dot(N, M) - ALIKE) / (1.0 - ALIKE), high = fabs(dot(d, N)) / reach;
    f64 near = 1.0 - dot(d, d) / (reach * reach);
    if (near <= 0.0 || alike <= 0.0 || high >= 0.5) return 0.0;
    return square(near) * square(alike) * square(1.0 - 4.0 * high * high);
}

/* Fills the sources of corners at P with normals N of instances `of`, up to s each, with their weights; −1: no more.
   Sources are those of cells, begin[c] to begin[c + 1], whose keys are in a table. */
KERNEL(thinned_around,
       "slots i32[e]  entered u64[q]  begin i32[c]  edge f64  reach f64  Q f64[m,3]  M f64[m,3]  own i32[m]  P f64[n,3]  "
       "N f64[n,3]  of i32[n]  source i32[n,s]!  weight f64[n,s]!"
       ";  power(e)  0<edge<inf  0<=reach<inf  0<=begin<=m")
i64 thinned_around(i64 e, i64 q, i64 c, i64 m, i64 n, i64 s, const i32 *slots, const u64 *entered, const i32 *begin,
                   f64 edge, f64 reach, const f64 *Q, const f64 *M, const i32 *own, const f64 *P, const f64 *N,
                   const i32 *of, i32 *source, f64 *weight) {
    (void)m;
    for (i64 k = 0; k < n; k++) {
        i64 from[3], to[3], at[3], count = 0;
        for (int j = 0; j < 3; j++) {
            from[j] = (i64)floor((P[3 * k + j] - reach) / edge), to[j] = (i64)floor((P[3 * k + j] + reach) / edge);
        }
        for (at[0] = from[0]; at[0] <= to[0]; at[0]++)
            for (at[1] = from[1]; at[1] <= to[1]; at[1]++)
                for (at[2] = from[2]; at[2] <= to[2]; at[2]++) {
                    i64 cell = known_number(slots, e, entered, q, packed(at));
                    if (cell < 0 || cell + 1 >= c) continue;
                    for (i64 i = begin[cell]; i < begin[cell + 1] && count < s; i++) {
                        f64 w = own[i] == of[k] ? counts(P + 3 * k, N + 3 * k, Q + 3 * i, M + 3 * i, reach) : 0.0;
                        if (w > 0.0) source[s * k + count] = (i32)i, weight[s * k + count++] = w;
                    }
                }
        for (; count < s; count++) source[s * k + count] = -1, weight[s * k + count] = 0.0;
    }
    return 0;
}

/* The mean of what records say of each sector around N. */
static void mean_sectors(i64 s, const i32 *number, const f64 *weight, const f64 *N, const f64 *M, const u32 *known,
                         u32 *sectors) {
    f64 t[3], b[3], sum[SECTORS][3] = {{0}}, all = 0.0;
    tangents(N, t, b);
    for (i64 i = 0; i < s; i++) {
        const f64 *m = M + 3 * (i64)number[i];
        f64 u[3], v[3], to[3][3];
        if (!(weight[i] > 0.0)) continue;
        tangents(m, u, v), all += weight[i];
        const f64 *from[3] = {t, b, N}, *axis[3] = {u, v, m};
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++) to[p][q] = dot(axis[p], from[q]);
        for (int k = 0; k < SECTORS; k++) {
            f64 d[3], x = 0.0, y = 0.0, z = 0.0;
            f32 L[3];
            sector_middle(k, d);
            for (int q = 0; q < 3; q++) x += to[0][q] * d[q], y += to[1][q] * d[q], z += to[2][q] * d[q];
            f64 by = z > 0.0 ? 1.0 : 1.0 / sqrt(fmax(x * x + y * y, 1e-12));  /* below the record's plane: at its edge */
            light_unpacked(known[SECTORS * (i64)number[i] + sector_of(by * x, by * y)], L);
            for (int j = 0; j < 3; j++) sum[k][j] += weight[i] * L[j];
        }
    }
    for (int k = 0; k < SECTORS; k++) {
        for (int j = 0; j < 3; j++) sum[k][j] /= all;
        sectors[k] = light_packed(sum[k]);
    }
}

/* Fills what corners with normals N get from records: their means for N and for the four normals that lean, the mean of
   inverse and open, the least of nearest; and of their sectors, where there are. number: of the records of each corner,
   with their weights. */
KERNEL(thinned_mean,
       "number i32[n,s]  weight f64[n,s]  N f64[n,3]  M f64[r,3]  means f32[r,5,3]  inverses f32[r]  nears f32[r]  "
       "opens f32[r]  known u32[r,64]?  mean f32[n,5,3]!  inverse f32[n]!  nearest f32[n]!  open f32[n]!  sectors u32[n,64]?!"
       ";  -1<=number<r")
i64 thinned_mean(i64 n, i64 s, i64 r, const i32 *number, const f64 *weight, const f64 *N, const f64 *M, const f32 *means,
                 const f32 *inverses, const f32 *nears, const f32 *opens, const u32 *known, f32 *mean, f32 *inverse,
                 f32 *nearest, f32 *open, u32 *sectors) {
    (void)r;
    for (i64 k = 0; k < n; k++) {
        f64 normal[5][3], t[3], b[3], sum[5][3] = {{0}}, all = 0.0, near = 0.0, free = 0.0, least = 1e30;
        tangents(N + 3 * k, t, b);
        for (int j = 0; j < 3; j++) {
            f64 up = N[3 * k + j];
            normal[0][j] = up;
            normal[1][j] = LEAN_COSINE * up + LEAN_SINE * t[j], normal[2][j] = LEAN_COSINE * up - LEAN_SINE * t[j];
            normal[3][j] = LEAN_COSINE * up + LEAN_SINE * b[j], normal[4][j] = LEAN_COSINE * up - LEAN_SINE * b[j];
        }
        for (i64 i = 0; i < s; i++) {
            f64 w = weight[s * k + i];
            i64 of = number[s * k + i];
            if (!(w > 0.0)) continue;
            if (of < 0) return OUTSIDE;
            for (int c = 0; c < 5; c++) {
                f64 one[3];
                leaning(means + 15 * of, M + 3 * of, normal[c], one);
                /* the record sees nothing below its own plane, and the corner nothing below its own */
                f64 seen = (1.0 + dot(normal[c], normal[0])) / fmax(1.0 + dot(normal[c], M + 3 * of), 0.5);
                for (int j = 0; j < 3; j++) sum[c][j] += w * seen * one[j];
            }
            all += w, near += w * inverses[of], free += w * opens[of], least = nears[of] < least ? nears[of] : least;
        }
        for (int c = 0; c < 5; c++)
            for (int j = 0; j < 3; j++) mean[15 * k + 3 * c + j] = (f32)(sum[c][j] / all);
        if (sectors && known) mean_sectors(s, number + s * k, weight + s * k, N + 3 * k, M, known, sectors + SECTORS * k);
        inverse[k] = (f32)(near / all), nearest[k] = (f32)least, open[k] = (f32)(free / all);
    }
    return 0;
}
