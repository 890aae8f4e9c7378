/* Finds the bodies of glass around points (bodies.py). */
#include "../rays/triangles.h"

/* Computes how often closed surfaces wind around points: the sum of solid angles (van Oosterom and Strackee 1983) /
   4π. sign: −1 if a triangle's winding is reversed. */
KERNEL(bodies_winding, "corners f64[t,3,3]  sign f64[t]  points f64[n,3]  turns f64[n]!")
i64 bodies_winding(i64 t, i64 n, const f64 *corners, const f64 *sign, const f64 *points, f64 *turns) {
    for (i64 p = 0; p < n; p++) {
        f64 total = 0.0;
        for (i64 k = 0; k < t; k++) {
            f64 a[3], b[3], c[3], normal[3];
            for (int j = 0; j < 3; j++) {
                const f64 *corner = corners + 9 * k + j;
                a[j] = corner[0] - points[3 * p + j], b[j] = corner[3] - points[3 * p + j], c[j] = corner[6] - points[3 * p + j];
            }
            f64 A = sqrt(dot(a, a)), B = sqrt(dot(b, b)), C = sqrt(dot(c, c));
            cross(b, c, normal);
            total += sign[k] * atan2(dot(a, normal), A * B * C + dot(a, b) * C + dot(b, c) * A + dot(c, a) * B);
        }
        turns[p] = total / (2.0 * PI);
    }
    return 0;
}
