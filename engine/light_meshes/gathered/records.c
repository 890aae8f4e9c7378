/* What the rays of records gather (records.py). */
#include "sectors.h"

/* The light that one ray found. */
static inline const f64 *found_by(i64 of, const f64 *patch, const f64 *extra, const f64 *sky) {
    return of >= 0 ? patch + 3 * of : of == -1 ? sky : extra + 3 * (-2 - of);
}

/* The mean light of each sector; 0 where no ray goes. */
static void sum_sectors(i64 d, const i32 *number, const f64 *patch, const f64 *extra, const f64 *sky, const u8 *in,
                        u32 *sectors) {
    f64 sum[SECTORS][3] = {{0}}, rays[SECTORS] = {0};
    for (i64 i = 0; i < d; i++) {
        const f64 *L = found_by(number[i], patch, extra, sky);
        rays[in[i]] += 1.0;
        for (int j = 0; j < 3; j++) sum[in[i]][j] += L[j];
    }
    for (int k = 0; k < SECTORS; k++) {
        for (int j = 0; j < 3; j++) sum[k][j] /= fmax(rays[k], 1.0);
        sectors[k] = light_packed(sum[k]);
    }
}

/* Sums up what the rays of each record found. tilted: by how much more each ray counts for normals that lean to four
   sides. number: of the patch that each met, whose light is a row of `patch`; −1: nothing, where the world has the light
   `sky`; from −2 down: a row, 0 on, of `extra`. mean (r,5,3): of light, for M and for these. inverse: mean of 1/distance, or that weighted by light if it is
   more. nearest: the shortest way; open: share of rays that hit nothing. noise: about how wrong the mean is, as a share of
   it, because the rays are few: within the part of the half-space for which a ray speaks, light varies about as much as
   between it and the rays beside it. sectors: None, or the light of each (sectors.h), of which `glossy` and `glossy_extra` tell, where there are;
   in: the sector of each ray.
   beside, below: the rays so many places on go about the same way as a ray. */
KERNEL(records_sum,
       "distance f32[r,d]  number i32[r,d]  patch f64[m,3]  extra f64[e,3]  glossy f64[w,3]?  glossy_extra f64[e,3]?  sky f64[3]  tilted f64[d,4]  in u8[d]  beside i64  below i64  "
       "mean f32[r,5,3]!  inverse f32[r]!  nearest f32[r]!  open f32[r]!  noise f32[r]!  sectors u32[r,64]?!"
       ";  -2-e<number<m  in<64  0<=beside  0<=below")
i64 records_sum(i64 r, i64 d, i64 m, i64 e, i64 w, const f32 *distance, const i32 *number, const f64 *patch,
                const f64 *extra, const f64 *glossy, const f64 *glossy_extra, const f64 *sky, const f64 *tilted, const u8 *in, i64 beside, i64 below, f32 *mean, f32 *inverse, f32 *nearest, f32 *open,
                f32 *noise, u32 *sectors) {
    (void)e;
    if (glossy && (w < m || !glossy_extra)) return OUTSIDE;
    for (i64 k = 0; k < r; k++) {
        if (sectors)
            sum_sectors(d, number + k * d, glossy ? glossy : patch, glossy ? glossy_extra : extra, sky, in,
                        sectors + SECTORS * k);
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
            if (i + beside < d && i + below < d) {
                const f64 *a = found_by(of[i + beside], patch, extra, sky), *b = found_by(of[i + below], patch, extra, sky);
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

/* Fills the sectors in which directions around z are. */
KERNEL(sectors_of, "local f64[d,3]  in u8[d]!")
i64 sectors_of(i64 d, const f64 *local, u8 *in) {
    for (i64 i = 0; i < d; i++) in[i] = (u8)sector_of(local[3 * i], local[3 * i + 1]);
    return 0;
}
