/* Blender's procedural textures (procedural.py). Places are (n,4): x, y, z, and w of textures in four dimensions; one
   of one dimension has it in x. */
#include "noise.h"

static Place4 place_at(const f64 *place, i64 k) {
    return (Place4){{(f32)place[4 * k], (f32)place[4 * k + 1], (f32)place[4 * k + 2], (f32)place[4 * k + 3]}};
}

/* out: the value, and a colour, or 0 where no colour is asked for. how: (n,6) detail, roughness, lacunarity, offset, gain, distortion. */
KERNEL(procedural_noise, "place f64[n,4]  how f64[n,6]  dimensions i64  kind i64  normalize i64  colour i64  out f64[n,4]!"
       ";  1<=dimensions<=4")
i64 procedural_noise(i64 n, const f64 *place, const f64 *how, i64 dimensions, i64 kind, i64 normalize, i64 colour,
                     f64 *out) {
    int d = (int)dimensions;
    for (i64 k = 0; k < n; k++) {
        const f64 *h = how + 6 * k;
        f64 detail = h[0] < 0.0 ? 0.0 : h[0] > 15.0 ? 15.0 : h[0];
        Fractal f = {(int)kind, (int)normalize, (f32)(isfinite(detail) ? detail : 0.0), (f32)(h[1] > 0.0 ? h[1] : 0.0),
                     (f32)h[2], (f32)h[3], (f32)h[4]};
        Place4 p = place_at(place, k), moved = p;
        if (h[5] != 0.0)
            for (int j = 0; j < d; j++) {
                Place4 q = elsewhere(&p, d, j);
                moved.v[j] += noise_signed(&q, d) * (f32)h[5];
            }
        f64 value = fractal(&moved, d, &f);
        out[4 * k] = out[4 * k + 1] = value;
        out[4 * k + 2] = out[4 * k + 3] = 0.0;
        if (!colour) continue;
        Place4 green = elsewhere(&moved, d, d), blue = elsewhere(&moved, d, d + 1);
        out[4 * k + 2] = fractal(&green, d, &f);
        out[4 * k + 3] = fractal(&blue, d, &f);
    }
    return 0;
}

/* out: a value and a colour that have nothing to do with those of any other place. */
KERNEL(procedural_white_noise, "place f64[n,4]  dimensions i64  out f64[n,4]!"
       ";  1<=dimensions<=4")
i64 procedural_white_noise(i64 n, const f64 *place, i64 dimensions, f64 *out) {
    int d = (int)dimensions;
    for (i64 k = 0; k < n; k++) {
        Place4 p = place_at(place, k);
        out[4 * k] = out[4 * k + 1] = hash_numbers(p.v, d);
        if (d < 4) {
            p.v[d] = 1.0f;
            out[4 * k + 2] = hash_numbers(p.v, d + 1);
            p.v[d] = 2.0f;
            out[4 * k + 3] = hash_numbers(p.v, d + 1);
        } else {
            f32 green[4] = {p.v[2], p.v[0], p.v[3], p.v[1]}, blue[4] = {p.v[3], p.v[2], p.v[1], p.v[0]};
            out[4 * k + 2] = hash_numbers(green, 4);
            out[4 * k + 3] = hash_numbers(blue, 4);
        }
    }
    return 0;
}

/* What waves are bent by: noise from −1 to 1 at place (n,4), by how (n,2): detail and roughness. */
KERNEL(procedural_bend, "place f64[n,4]  how f64[n,2]  out f64[n]!")
i64 procedural_bend(i64 n, const f64 *place, const f64 *how, f64 *out) {
    for (i64 k = 0; k < n; k++) {
        f64 detail = how[2 * k] > 0.0 ? how[2 * k] < 15.0 ? how[2 * k] : 15.0 : 0.0;
        Fractal f = {FBM, 1, (f32)detail, (f32)how[2 * k + 1], 2.0f, 0.0f, 0.0f};
        Place4 p = place_at(place, k);
        out[k] = 2.0f * fractal(&p, 3, &f) - 1.0f;
    }
    return 0;
}

/* out: a colour of turned sines; depth: how often they are turned, 0 to 10. */
KERNEL(procedural_magic, "place f64[n,4]  distortion f64[n]  depth i64  out f64[n,3]!")
i64 procedural_magic(i64 n, const f64 *place, const f64 *distortion, i64 depth, f64 *out) {
    for (i64 k = 0; k < n; k++) {
        f64 px = place[4 * k], py = place[4 * k + 1], pz = place[4 * k + 2], d = distortion[k];
        f64 x = sin((px + py + pz) * 5.0), y = cos((-px + py - pz) * 5.0), z = -cos((-px - py + pz) * 5.0);
        if (depth > 0) {
            x *= d, y *= d, z *= d;
            y = -cos(x - y + z) * d;
            if (depth > 1) x = cos(x - y - z) * d;
            if (depth > 2) z = sin(-x - y - z) * d;
            if (depth > 3) x = -cos(-x + y - z) * d;
            if (depth > 4) y = -sin(-x + y + z) * d;
            if (depth > 5) y = -cos(-x + y + z) * d;
            if (depth > 6) x = cos(x + y + z) * d;
            if (depth > 7) z = sin(x + y - z) * d;
            if (depth > 8) x = -cos(-x - y + z) * d;
            if (depth > 9) y = -sin(x - y + z) * d;
        }
        if (d != 0.0) x /= 2.0 * d, y /= 2.0 * d, z /= 2.0 * d;
        out[3 * k] = 0.5 - x, out[3 * k + 1] = 0.5 - y, out[3 * k + 2] = 0.5 - z;
    }
    return 0;
}

static f64 brick_tint(u32 n) {
    n = (n + 1013u) & 0x7fffffffu;
    n = (n >> 13) ^ n;
    return 0.5 * ((f64)((n * (n * n * 60493u + 19990303u) + 1376312589u) & 0x7fffffffu) / 1073741824.0);
}

static i64 modulo(i64 a, i64 b) { return a - b * (a / b); }

/* out: each brick's tint, and how much is mortar. how (n,5): mortar's size and smoothness, bias, width, height of a row.
   Every so many rows (frequencies; 0: never) bricks are moved by `offset` of their width, or have `squash` of it. */
KERNEL(procedural_brick, "place f64[n,4]  how f64[n,5]  offset f64  offset_frequency i64  squash f64  squash_frequency i64  out f64[n,2]!")
i64 procedural_brick(i64 n, const f64 *place, const f64 *how, f64 offset, i64 offset_frequency, f64 squash,
                     i64 squash_frequency, f64 *out) {
    for (i64 k = 0; k < n; k++) {
        const f64 *h = how + 5 * k;
        f64 width = h[3], height = h[4], moved = 0.0;
        f64 rows = floor(place[4 * k + 1] / height);
        i64 row = fabs(rows) < 2147483648.0 ? (i64)rows : 0;
        if (offset_frequency && squash_frequency) {
            if (modulo(row, squash_frequency) == 0) width *= squash;
            if (modulo(row, offset_frequency) == 0) moved = width * offset;
        }
        f64 bricks = floor((place[4 * k] + moved) / width);
        i64 brick = fabs(bricks) < 2147483648.0 ? (i64)bricks : 0;
        f64 x = place[4 * k] + moved - width * (f64)brick, y = place[4 * k + 1] - height * (f64)row;
        f64 tint = brick_tint(((u32)row << 16) + ((u32)brick & 0xFFFFu)) + h[2];
        f64 edge = fmin(fmin(x, y), fmin(width - x, height - y)), mortar = 0.0;
        if (edge < h[0]) {
            f64 inside = 1.0 - edge / h[0], t = inside / h[1];
            mortar = h[1] == 0.0 || t >= 1.0 ? 1.0 : t <= 0.0 ? 0.0 : t * t * (3.0 - 2.0 * t);
        }
        out[2 * k] = tint < 0.0 ? 0.0 : tint > 1.0 ? 1.0 : tint;
        out[2 * k + 1] = mortar;
    }
    return 0;
}
