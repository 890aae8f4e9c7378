/* Sums over the rays of a tile (passes.py). */
#include "native.h"

/* Adds weight·colour to samples[pixel], beginning at column `first`; colour has a row for each ray, or one for all. If
   several rays belong to one pixel, they are added in their order. */
KERNEL(passes_add, "samples f64[s,q]!  first i64  pixel i64[n]  weight f64[n,c]  colour f64[m,c]"
       ";  m=n|m=1  0<=first  first+c<=q  0<=pixel<s")
i64 passes_add(i64 s, i64 q, i64 n, i64 c, i64 m, f64 *samples, i64 first, const i64 *pixel, const f64 *weight,
               const f64 *colour) {
    (void)s;
    for (i64 k = 0; k < n; k++) {
        const f64 *own = colour + (m == 1 ? 0 : k * c);
        for (i64 j = 0; j < c; j++) samples[pixel[k] * q + first + j] += weight[k * c + j] * own[j];
    }
    return 0;
}

/* Taps: how many are in each pixel around; where they are, up and to the right of the pixel that takes them; which
   sample of it they are, how far away it is in the samples of the tile, and what they weigh. */
typedef struct { i64 pixels; const i64 *count, *up, *right, *sample, *away; const f64 *weight; } Taps;

/* Sets `sum`, of q channels, to that of the taps of the pixel (x,y), of width × height, whose samples begin at `own`.
   Those of each pixel around are added by themselves, and then these sums. All are there if the pixel is `inside`. */
static inline void filtered(const f64 *own, i64 q, i64 width, i64 height, i64 x, i64 y, int inside, const Taps *taps,
                            f64 *part, f64 *sum) {
    for (i64 j = 0; j < q; j++) sum[j] = 0.0;
    for (i64 k = 0, i = 0; k < taps->pixels; i += taps->count[k++]) {
        if (!inside) {
            i64 u = x + taps->right[i], v = y + taps->up[i];
            if (u < 0 || u >= width || v < 0 || v >= height) continue;
        }
        for (i64 j = 0; j < q; j++) part[j] = 0.0;
        for (i64 n = i; n < i + taps->count[k]; n++)
            for (i64 j = 0; j < q; j++) part[j] += taps->weight[n] * own[taps->away[n] * q + j];
        for (i64 j = 0; j < q; j++) sum[j] += part[j];
    }
}

/* Filters the pixels x0..x1, y0..y1 (box) of a tile of `width` pixels a row, by Taps. `away` is filled. */
KERNEL(passes_filtered,
       "samples f64[s,q]  width i64  per_pixel i64  box i64[4]  count i64[k]  up i64[t]  right i64[t]  sample i64[t]  "
       "weight f64[t]  away i64[t]!  part f64[q]!  sums f64[p,q]!"
       ";  0<width  0<per_pixel  0<=box  1<=count  -1000<up<1000  -1000<right<1000  0<=sample<per_pixel")
i64 passes_filtered(i64 s, i64 q, i64 pixels, i64 t, i64 p, const f64 *samples, i64 width, i64 per_pixel,
                    const i64 *box, const i64 *count, const i64 *up, const i64 *right, const i64 *sample,
                    const f64 *weight, i64 *away, f64 *part, f64 *sums) {
    i64 height = s / per_pixel / width, reach = 0, k = 0;
    for (i64 i = 0; i < pixels; i++) k += count[i] <= t - k ? count[i] : t + 1;
    if (k != t) return -1;
    for (i64 i = 0; i < t; i++) {
        away[i] = (up[i] * width + right[i]) * per_pixel + sample[i];
        for (int sign = -1; sign <= 1; sign += 2) {
            if (sign * up[i] > reach) reach = sign * up[i];
            if (sign * right[i] > reach) reach = sign * right[i];
        }
    }
    const Taps taps = {pixels, count, up, right, sample, away, weight};
    k = 0;
    for (i64 y = box[1]; y < box[3] && y < height; y++)
        for (i64 x = box[0]; x < box[2] && x < width && k < p; x++, k++) {
            int inside = x >= reach && x + reach < width && y >= reach && y + reach < height;
            const f64 *own = samples + (y * width + x) * per_pixel * q;
            f64 few[2][4], *to = sums + q * k;
            /* faster with a number that is known, and places of their own for the sums */
            if (q == 4) filtered(own, 4, width, height, x, y, inside, &taps, few[0], few[1]);
            else if (q == 3) filtered(own, 3, width, height, x, y, inside, &taps, few[0], few[1]);
            else if (q == 1) filtered(own, 1, width, height, x, y, inside, &taps, few[0], few[1]);
            else filtered(own, q, width, height, x, y, inside, &taps, part, to);
            if (q == 4 || q == 3 || q == 1) for (i64 j = 0; j < q; j++) to[j] = few[1][j];
        }
    return k;
}

/* The means of the samples of each pixel, added in order. */
KERNEL(passes_means, "samples f64[s,q]  means f64[p,q]!"
       ";  p<=s")
i64 passes_means(i64 s, i64 q, i64 p, const f64 *samples, f64 *means) {
    i64 count = p ? s / p : 0;
    for (i64 k = 0; k < p; k++)
        for (i64 j = 0; j < q; j++) {
            const f64 *from = samples + k * count * q + j;
            f64 total = from[0];
            for (i64 i = 1; i < count; i++) total += from[i * q];
            means[k * q + j] = total / (f64)count;
        }
    return 0;
}
