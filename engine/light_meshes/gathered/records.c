/* What the rays of records gather (records.py). */
#include "native.h"

#define BESIDE 21  /* the ray so many places on goes about the same way, */
#define BELOW 34   /* and this one, too, as the spiral turns by the golden angle */

/* The light that one ray found. */
static inline const f64 *found_by(i64 of, const f64 *patch, const f64 *extra, const f64 *sky) {
    return of >= 0 ? patch + 3 * of : of == -1 ? sky : extra + 3 * (-2 - of);
}

/* Sums up what the rays of each record found. tilted: by how much more each ray counts for normals that lean to four
   sides. number: of the patch that each met, whose light is a row of `patch`; −1: nothing, where the world has the light
   `sky`; from −2 down: a row, 0 on, of `extra`. mean (r,5,3): of light, for M and for these. inverse: mean of 1/distance, or that weighted by light if it is
   more. nearest: the shortest way; open: share of rays that hit nothing. noise: about how wrong the mean is, as a share of
   it, because the rays are few: within the part of the half-space for which a ray speaks, light varies about as much as
   between it and the rays beside it. */
KERNEL(records_sum,
       "distance f32[r,d]  number i32[r,d]  patch f64[m,3]  extra f64[e,3]  sky f64[3]  tilted f64[d,4]  mean f32[r,5,3]!  "
       "inverse f32[r]!  nearest f32[r]!  open f32[r]!  noise f32[r]!"
       ";  -2-e<number<m")
i64 records_sum(i64 r, i64 d, i64 m, i64 e, const f32 *distance, const i32 *number, const f64 *patch, const f64 *extra,
                const f64 *sky, const f64 *tilted, f32 *mean, f32 *inverse, f32 *nearest, f32 *open, f32 *noise) {
    (void)m, (void)e;
    for (i64 k = 0; k < r; k++) {
        const i32 *of = number + k * d;
        f64 sum[5][3] = {{0}}, near = 0.0, bright = 0.0, all = 0.0, least = 1e30, varies = 0.0;
        i64 free = 0;
        for (i64 i = 0; i < d; i++) {
            const f64 *L = found_by(of[i], patch, extra, sky);
            f64 far = distance[k * d + i], grey = L[0] + L[1] + L[2];
            for (int j = 0; j < 3; j++) {
                sum[0][j] += L[j];
                for (int c = 0; c < 4; c++) sum[1 + c][j] += tilted[4 * i + c] * L[j];
            }
            if (i + BELOW < d) {
                const f64 *a = found_by(of[i + BESIDE], patch, extra, sky), *b = found_by(of[i + BELOW], patch, extra, sky);
                varies += square(grey - a[0] - a[1] - a[2]) + square(grey - b[0] - b[1] - b[2]);
            }
            all += grey;
            if (far > 0.0) near += 1.0 / far, bright += grey / far, least = far < least ? far : least;
            else free++;
        }
        for (int c = 0; c < 5; c++)
            for (int j = 0; j < 3; j++) mean[15 * k + 3 * c + j] = (f32)(sum[c][j] / (f64)d);
        near /= (f64)d, bright = all > 0.0 ? bright / all : 0.0;
        inverse[k] = (f32)(bright > near ? bright : near), nearest[k] = (f32)least, open[k] = (f32)free / (f32)d;
        noise[k] = (f32)(all > 0.0 ? 0.5 * sqrt(varies) / all : 0.0);
    }
    return 0;
}
