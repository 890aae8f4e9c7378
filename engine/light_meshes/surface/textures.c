/* Image textures (textures.py). */
#include "native.h"

enum { REPEAT, EXTEND, CLIP, MIRROR };
enum { LINEAR, CLOSEST, CUBIC };

/* Returns the index of the texel at x, or −1 outside of a clipped image. */
static i64 wrap(i64 x, i64 size, i64 extension) {
    switch (extension) {
    case REPEAT:
        return (x % size + size) % size;
    case MIRROR:
        x = (x % (2 * size) + 2 * size) % (2 * size);
        return x < size ? x : 2 * size - 1 - x;
    case CLIP:
        if (x < 0 || x >= size) return -1;
    }
    return x < 0 ? 0 : x < size ? x : size - 1;
}

/* How texels become colours. Texels are indices into `linear`, or, if that is empty, linear values themselves.
   first, step: the channels of the colours; a grey image uses one channel for all. weighing: the channel that
   weights texels when they are blended, converted by `straight`, −1 if none; divides: whether to divide by the sum
   of the weights. interpolation: LINEAR, CLOSEST, CUBIC. matrix: NULL if none. */
typedef struct {
    i64 height, width, channels, first, step, weighing, divides, interpolation, extension;
    const f32 *linear, *straight;
    const f64 *matrix;
} Look;

/* Where a texture is looked up: the index of the first texel that counts, how many count in each direction, and the shares
   of each. */
typedef struct {
    i64 x, y;
    int side;
    f64 across[4], up[4];
} Place;

/* The shares of two texels, or of four by a cubic B-spline, at the place f between the middle two. */
static void shares_at(f64 f, int side, f64 *share) {
    if (side == 2) {
        share[0] = 1.0 - f, share[1] = f;
    } else {
        share[0] = (1.0 - f) * (1.0 - f) * (1.0 - f) / 6.0;
        share[1] = (4.0 + f * f * (3.0 * f - 6.0)) / 6.0;
        share[3] = f * f * f / 6.0;
        share[2] = 1.0 - share[0] - share[1] - share[3];
    }
}

static Place place_of(const Look *look, const f32 *uv) {
    f64 x = (f64)uv[0] * (f64)look->width, y = (1.0 - (f64)uv[1]) * (f64)look->height;
    if (!(fabs(x) < 1e9 && fabs(y) < 1e9)) x = 0.0, y = 0.0;
    if (look->interpolation == CLOSEST) x = floor(x), y = floor(y);
    else x = x - 0.5, y = y - 0.5;
    Place p = {(i64)floor(x), (i64)floor(y), 2, {0.0}, {0.0}};
    if (look->interpolation == CUBIC) p.x--, p.y--, p.side = 4;
    shares_at(x - floor(x), p.side, p.across), shares_at(y - floor(y), p.side, p.up);
    return p;
}

/* Applies the matrix, if there is one, and replaces values below 0 (outside of the scene's gamut) and NaNs by 0. */
static void finish(const Look *look, i64 count, f64 *colour) {
    if (look->matrix) {
        f64 r = colour[0], g = colour[1], b = colour[2];
        for (int c = 0; c < 3; c++) colour[c] = look->matrix[3 * c] * r + look->matrix[3 * c + 1] * g + look->matrix[3 * c + 2] * b;
    }
    for (i64 c = 0; c < count; c++)
        if (!(colour[c] > 0.0)) colour[c] = 0.0;
}

/* Fills alpha with the share of a clipped image's texels at uv that are inside. */
KERNEL(textures_coverage, "height i64  width i64  interpolation i64  uv f32[n,2]  alpha f64[n,one]!")
i64 textures_coverage(i64 n, i64 one, i64 height, i64 width, i64 interpolation, const f32 *uv, f64 *alpha) {
    Look look = {.height = height, .width = width, .interpolation = interpolation};
    for (i64 k = 0; k < n; k++) {
        Place place = place_of(&look, uv + 2 * k);
        f64 across = 0.0, up = 0.0;
        for (int i = 0; i < place.side; i++) {
            across += wrap(place.x + i, width, CLIP) < 0 ? 0.0 : place.across[i];
            up += wrap(place.y + i, height, CLIP) < 0 ? 0.0 : place.up[i];
        }
        alpha[one * k] = across * up;
    }
    return 0;
}

/* Fills out with the texels that count at uv[rows]: row · width + column; −1: none. */
KERNEL(textures_needed, "height i64  width i64  interpolation i64  extension i64  uv f32[n,2]  rows i64[r]  out i64[r,s]!")
i64 textures_needed(i64 n, i64 r, i64 s, i64 height, i64 width, i64 interpolation, i64 extension, const f32 *uv,
                    const i64 *rows, i64 *out) {
    Look look = {.height = height, .width = width, .interpolation = interpolation};
    (void)n;
    for (i64 k = 0; k < r; k++) {
        Place place = place_of(&look, uv + 2 * rows[k]);
        for (int at = 0; at < s; at++) {
            int dx = at % place.side, dy = at / place.side;
            i64 i = wrap(place.x + dx, width, extension), j = wrap(place.y + dy, height, extension);
            out[k * s + at] = i < 0 || j < 0 || place.across[dx] * place.up[dy] == 0.0 ? -1 : j * width + i;
        }
    }
    return 0;
}

#define T u8
#define T_NAME "u8"
#define NAME(kernel) kernel##_u8
#include "textures_look.h"
#undef T
#undef T_NAME
#undef NAME
#define T u16
#define T_NAME "u16"
#define NAME(kernel) kernel##_u16
#include "textures_look.h"
#undef T
#undef T_NAME
#undef NAME
#define T f32
#define T_NAME "f32"
#define NAME(kernel) kernel##_f32
#include "textures_look.h"
