/* What a record's five means say of other normals (directions.py has the four that lean). */
#pragma once
#include "../rays/triangles.h"

/* The light that a record gathers for another unit normal N than its own, M: a square law between the five. */
static inline void leaning(const f32 *mean, const f64 *M, const f64 *N, f64 *out) {
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
