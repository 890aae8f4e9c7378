/* Where image textures are looked up, and what texels there become (textures.py). */
#pragma once
#include "native.h"

enum { REPEAT, EXTEND, CLIP, MIRROR };
enum { LINEAR, CLOSEST, CUBIC };

/* Returns the index of the texel at x, or −1 outside of a clipped image. */
static inline i64 wrap(i64 x, i64 size, i64 extension) {
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

/* How texels become colours. Texels are indices into `colours`, or, if that is empty, values themselves.
   first, step: the channels of the colours; a grey image uses one channel for all. weighing: the channel that
   weights texels when they are blended, converted by `straight`, −1 if none; weighted: whether they are multiplied by it
   already; divides: whether to divide by the sum of the weights. interpolation: LINEAR, CLOSEST, CUBIC. matrix: NULL if none. decoded: the linear light of values
   0 to 1 of sRGB, `steps` + 1 of them, which blended colours are; NULL if they are linear light. */
typedef struct {
    i64 height, width, channels, first, step, weighing, weighted, divides, interpolation, extension;
    const f32 *colours, *straight;
    const f64 *matrix;
    const f32 *decoded;
    i64 steps;
} Look;

/* Where a texture is looked up: the index of the first texel that counts, how many count in each direction, and the shares
   of each. */
typedef struct {
    i64 x, y;
    int side;
    f64 across[4], up[4];
} Place;

/* The shares of two texels, or of four by a cubic B-spline, at the place f between the middle two. */
static inline void shares_at(f64 f, int side, f64 *share) {
    if (side == 2) {
        share[0] = 1.0 - f, share[1] = f;
    } else {
        share[0] = (1.0 - f) * (1.0 - f) * (1.0 - f) / 6.0;
        share[1] = (4.0 + f * f * (3.0 * f - 6.0)) / 6.0;
        share[3] = f * f * f / 6.0;
        share[2] = 1.0 - share[0] - share[1] - share[3];
    }
}

static inline Place place_of(const Look *look, const f32 *uv) {
    f64 x = (f64)uv[0] * (f64)look->width, y = (1.0 - (f64)uv[1]) * (f64)look->height;
    if (!(fabs(x) < 1e9 && fabs(y) < 1e9)) x = 0.0, y = 0.0;
    if (look->interpolation == CLOSEST) x = floor(x), y = floor(y);
    else x = x - 0.5, y = y - 0.5;
    Place p = {(i64)floor(x), (i64)floor(y), 2, {0.0}, {0.0}};
    if (look->interpolation == CUBIC) p.x--, p.y--, p.side = 4;
    shares_at(x - floor(x), p.side, p.across), shares_at(y - floor(y), p.side, p.up);
    return p;
}

/* The linear light of a value of sRGB: between two numbers of the table, an error below 1e-8; by its formula above 1. */
static inline f64 decoded_of(const Look *look, f64 value) {
    if (!(value > 0.0)) return 0.0;
    if (value >= 1.0) return value == 1.0 ? 1.0 : pow((value + 0.055) / 1.055, 2.4);
    f64 place = value * (f64)look->steps;
    i64 i = (i64)place;
    f64 low = look->decoded[i];
    return low + (place - (f64)i) * ((f64)look->decoded[i + 1] - low);
}

/* Makes blended values linear light, or applies the matrix, if there is one, and replaces values below 0 (outside of the
   scene's gamut) then by 0. Values that need neither may be below 0, as those of displacement. */
static inline void finish(const Look *look, i64 count, f64 *colour) {
    if (look->decoded)
        for (i64 c = 0; c < count; c++) colour[c] = decoded_of(look, colour[c]);
    if (look->matrix) {
        f64 r = colour[0], g = colour[1], b = colour[2];
        for (int c = 0; c < 3; c++) colour[c] = look->matrix[3 * c] * r + look->matrix[3 * c + 1] * g + look->matrix[3 * c + 2] * b;
    }
    for (i64 c = 0; c < count; c++)
        if (look->matrix ? !(colour[c] > 0.0) : colour[c] != colour[c]) colour[c] = 0.0;
}

/* The share of a clipped image's texels at uv that are inside. */
static inline f64 coverage_at(const Look *look, const f32 *uv) {
    Place place = place_of(look, uv);
    f64 across = 0.0, up = 0.0;
    for (int i = 0; i < place.side; i++) {
        across += wrap(place.x + i, look->width, CLIP) < 0 ? 0.0 : place.across[i];
        up += wrap(place.y + i, look->height, CLIP) < 0 ? 0.0 : place.up[i];
    }
    return across * up;
}

/* What texels are. */
enum { U8, U16, F32 };

/* The value of texel `at`: of a table of `length`, if there is one. */
static inline f32 value_of(const void *texels, int kind, i64 at, const f32 *table, i64 length) {
    if (kind == F32) {
        f32 value = ((const f32 *)texels)[at];
        return length ? table[(i64)value] : value;
    }
    i64 value = kind == U8 ? ((const u8 *)texels)[at] : ((const u16 *)texels)[at];
    return length ? table[value] : (f32)value;
}

/* Sets out (C) to the texture at uv. length: of the tables. gathered: texels are not those of the whole image, but those
   that `textures_needed` names for this place. */
static inline void blended(const Look *look, int kind, const void *texels, i64 length, i64 gathered, const f32 *uv, i64 C,
                           f64 *out) {
    Place place = place_of(look, uv);
    f64 total = 0.0;
    for (i64 j = 0; j < C; j++) out[j] = 0.0;
    for (int at = 0; at < place.side * place.side; at++) {
        int dx = at % place.side, dy = at / place.side;
        f64 weight = place.across[dx] * place.up[dy];
        if (weight == 0.0) continue;
        i64 i = wrap(place.x + dx, look->width, look->extension), j = wrap(place.y + dy, look->height, look->extension);
        if (i < 0 || j < 0) continue;
        i64 texel = (gathered ? at : j * look->width + i) * look->channels;
        if (look->weighing >= 0) {
            f64 alpha = value_of(texels, kind, texel + look->weighing, look->straight, length);
            total += weight * alpha;
            if (!look->weighted) weight *= alpha;
        }
        for (i64 k = 0; k < C; k++)
            out[k] += weight * value_of(texels, kind, texel + look->first + look->step * k, look->colours, length);
    }
    if (look->divides && total > 0.0)
        for (i64 j = 0; j < C; j++) out[j] /= total;
    finish(look, C, out);
}

/* The alpha of an image at uv. image: see Texture.alpha_texels; it must not be ASKED. */
enum { OPAQUE_IMAGE, CLIPPED, TEXELS_U8, TEXELS_U16, TEXELS_F32, ASKED };
enum { IMAGE_KIND, IMAGE_TEXELS, IMAGE_HEIGHT, IMAGE_WIDTH, IMAGE_CHANNELS, IMAGE_ALPHA, IMAGE_INTERPOLATION,
       IMAGE_EXTENSION, IMAGE_TABLE, IMAGE_LENGTH, IMAGE_NUMBERS };

static inline f64 alpha_at(const i64 *image, const f32 *uv) {
    const f32 *table = (const f32 *)(uintptr_t)image[IMAGE_TABLE];
    const void *texels = (const void *)(uintptr_t)image[IMAGE_TEXELS];
    Look look = {image[IMAGE_HEIGHT], image[IMAGE_WIDTH], image[IMAGE_CHANNELS], image[IMAGE_ALPHA], 0, -1, 0, 0,
                 image[IMAGE_INTERPOLATION], image[IMAGE_EXTENSION], table, table, 0, 0, 0};
    f64 alpha = 1.0;
    if (image[IMAGE_KIND] == CLIPPED) alpha = coverage_at(&look, uv);
    else if (image[IMAGE_KIND] != OPAQUE_IMAGE)
        blended(&look, (int)image[IMAGE_KIND] - TEXELS_U8, texels, image[IMAGE_LENGTH], 0, uv, 1, &alpha);
    return alpha;
}
