/* Rays of records, what they gather, and how receivers take it from the records around them (records.py). */
#include "grids.h"

/* Sums up what the rays of each record found. tilted: by how much more each ray counts for normals that lean to four
   sides. number: of the patch that each met, whose light is a row of `patch`; −1: nothing, where the world has the light
   `sky`; from −2 down: a row, 0 on, of `extra`. mean (r,5,3): of light, for M and for these. inverse: mean of 1/distance, or that weighted by light if it is
   more. nearest: the shortest way; open: share of rays that hit nothing. */
KERNEL(records_sum,
       "distance f32[r,d]  number i32[r,d]  patch f64[m,3]  extra f64[e,3]  sky f64[3]  tilted f64[d,4]  mean f32[r,5,3]!  "
       "inverse f32[r]!  nearest f32[r]!  open f32[r]!")
i64 records_sum(i64 r, i64 d, i64 m, i64 e, const f32 *distance, const i32 *number, const f64 *patch, const f64 *extra,
                const f64 *sky, const f64 *tilted, f32 *mean, f32 *inverse, f32 *nearest, f32 *open) {
    (void)m, (void)e;
    for (i64 k = 0; k < r; k++) {
        f64 sum[5][3] = {{0}}, near = 0.0, bright = 0.0, all = 0.0, least = 1e30;
        i64 free = 0;
        for (i64 i = 0; i < d; i++) {
            i64 of = number[k * d + i];
            const f64 *L = of >= 0 ? patch + 3 * of : of == -1 ? sky : extra + 3 * (-2 - of);
            f64 far = distance[k * d + i], grey = L[0] + L[1] + L[2];
            for (int j = 0; j < 3; j++) {
                sum[0][j] += L[j];
                for (int c = 0; c < 4; c++) sum[1 + c][j] += tilted[4 * i + c] * L[j];
            }
            all += grey;
            if (far > 0.0) near += 1.0 / far, bright += grey / far, least = far < least ? far : least;
            else free++;
        }
        for (int c = 0; c < 5; c++)
            for (int j = 0; j < 3; j++) mean[15 * k + 3 * c + j] = (f32)(sum[c][j] / (f64)d);
        near /= (f64)d, bright = all > 0.0 ? bright / all : 0.0;
        inverse[k] = (f32)(bright > near ? bright : near), nearest[k] = (f32)least, open[k] = (f32)free / (f32)d;
    }
    return 0;
}

/* Decides how far receivers trust the records around them: trust (n,) from 0 to 1, and whether something is so near
   that it may stand between them (close). within: spacing·inverse up to which they do, `strict` where
   records are far apart, so that many pixels hang on each. */
KERNEL(records_trust,
       "number i32[n,3]  weight f64[n,3]  spacing f64[n]  inverse f32[r]  nearest f32[r]  within f64  strict f64  fine f64  "
       "trust f64[n]!  close bool[n]!")
i64 records_trust(i64 n, i64 r, const i32 *number, const f64 *weight, const f64 *spacing, const f32 *inverse,
                  const f32 *nearest, f64 within, f64 strict, f64 fine, f64 *trust, u8 *close) {
    (void)r;
    for (i64 k = 0; k < n; k++) {
        f64 one = 0.0, near = 1e30, limit = spacing[k] > 6.0 * fine ? strict : within;
        for (int c = 0; c < 3; c++) {
            i64 of = number[3 * k + c];
            f64 most = 8.0 * limit / spacing[k], here = inverse[of];  /* one record must not spoil all around it */
            one += weight[3 * k + c] * (here < most ? here : most);
            near = nearest[of] < near ? nearest[of] : near;
        }
        f64 x = limit / (spacing[k] * one + 1e-300), t = (x - 0.75) / 0.5;
        t = t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
        trust[k] = spacing[k] <= fine ? 1.0 : t * t * (3.0 - 2.0 * t);
        close[k] = near < 1.5 * spacing[k];
    }
    return 0;
}

/* The light that a record gathers for another unit normal N than its own, M: a square law between the five. */
static void leaning(const f32 *mean, const f64 *M, const f64 *N, f64 *out) {
    f64 t[3], b[3];
    for (int j = 0; j < 3; j++) out[j] = mean[j];
    if (dot(M, N) > 1.0 - 1e-12) return;
    tangents(M, t, b);
    f64 p = dot(N, t), q = dot(N, b), reach = sqrt(p * p + q * q);
    if (dot(M, N) < 0.0 && reach > 0.0) p /= reach, q /= reach;
    for (int j = 0; j < 3; j++) {
        f64 slope_p = mean[3 + j] - mean[6 + j], slope_q = mean[9 + j] - mean[12 + j];
        f64 bend_p = 0.5 * (mean[3 + j] + mean[6 + j]) - mean[j], bend_q = 0.5 * (mean[9 + j] + mean[12 + j]) - mean[j];
        out[j] += p * slope_p + q * slope_q + 4.0 * (p * p * bend_p + q * q * bend_q);
        if (out[j] < 0.0) out[j] = 0.0;
    }
}

/* Adds share·trust of what the visible records say to light, and takes it from share. Where none is visible nothing
   is taken, but where `end` is set: then all count. */
KERNEL(records_blend,
       "number i32[n,3]  weight f64[n,3]  visible bool[n,3]?  trust f64[n]  end bool[n]  N f64[n,3]  M f64[r,3]  "
       "mean f32[r,5,3]  open f32[r]  share f64[n]!  light f64[n,3]!  sky f64[n]!")
i64 records_blend(i64 n, i64 r, const i32 *number, const f64 *weight, const u8 *visible, const f64 *trust, const u8 *end,
                  const f64 *N, const f64 *M, const f32 *mean, const f32 *open, f64 *share, f64 *light, f64 *sky) {
    (void)r;
    for (i64 k = 0; k < n; k++) {
        f64 w[3], sum = 0.0;
        if (!(trust[k] > 0.0)) continue;
        for (int c = 0; c < 3; c++) {
            w[c] = visible && !visible[3 * k + c] ? 0.0 : weight[3 * k + c];
            sum += w[c];
        }
        if (sum < 0.02) {
            if (!end[k]) continue;
            sum = 1.0;
            for (int c = 0; c < 3; c++) w[c] = weight[3 * k + c];
        }
        f64 part = share[k] * trust[k];
        for (int c = 0; c < 3; c++) {
            f64 one[3], by = part * w[c] / sum;
            i64 of = number[3 * k + c];
            if (by == 0.0) continue;
            leaning(mean + 15 * of, M + 3 * of, N + 3 * k, one);
            for (int j = 0; j < 3; j++) light[3 * k + j] += by * one[j];
            sky[k] += by * open[of];
        }
        share[k] -= part;
    }
    return 0;
}
