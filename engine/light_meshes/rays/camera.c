/* Camera rays (camera.py). */
#include "native.h"

/* Computes the rays of the pixels x0..x1, y0..y1 (box; bottom row first), with all samples of a pixel in sequence,
   starting at depth `near`. stretch: the length along the ray for a depth of 1. A sample starts at its point on the
   lens, and per unit of depth its direction is shifted sideways by its tilt, so that all samples that aim at the
   same place meet where the camera is focused. */
KERNEL(camera_rays_of,
       "matrix f64[4,4]  window f64[4]  perspective i64  near f64  width i64  height i64  box i64[4]  offsets f64[s,2]  "
       "lens f64[s,2]  tilt f64[s,2]  origin f64[n,3]!  direction f64[n,3]!  stretch f64[n]!")
i64 camera_rays_of(i64 samples, i64 n, const f64 *matrix, const f64 *window, i64 perspective, f64 near, i64 width,
                   i64 height, const i64 *box, const f64 *offsets, const f64 *lens, const f64 *tilt, f64 *origin,
                   f64 *direction, f64 *stretch) {
    i64 k = 0;
    for (i64 y = box[1]; y < box[3] && k < n; y++)
        for (i64 x = box[0]; x < box[2] && k < n; x++)
            for (i64 s = 0; s < samples && k < n; s++, k++) {
                f64 u = window[0] + (window[1] - window[0]) * ((f64)x + 0.5 + offsets[2 * s]) / (f64)width;
                f64 v = window[2] + (window[3] - window[2]) * ((f64)y + 0.5 + offsets[2 * s + 1]) / (f64)height;
                f64 ox = lens[2 * s], oy = lens[2 * s + 1], dx = -tilt[2 * s], dy = -tilt[2 * s + 1];
                if (perspective) dx = dx + u, dy = dy + v;
                else ox = ox + u, oy = oy + v;
                ox = ox + near * dx, oy = oy + near * dy;
                f64 oz = -near, length = sqrt(dx * dx + dy * dy + 1.0), dz = -1.0 / length;
                dx = dx / length, dy = dy / length;
                for (int r = 0; r < 3; r++) {
                    const f64 *m = matrix + 4 * r;
                    origin[3 * k + r] = m[0] * ox + m[1] * oy + m[2] * oz + m[3];
                    direction[3 * k + r] = m[0] * dx + m[1] * dy + m[2] * dz;
                }
                stretch[k] = length;
            }
    return k;
}
