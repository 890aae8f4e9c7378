/* Image textures (textures.py). */
#include "native.h"

enum { REPEAT, EXTEND, CLIP, MIRROR };

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
   of the weights. matrix: NULL if none. */
typedef struct {
    i64 height, width, channels, first, step, weighing, divides, closest, extension;
    const f32 *linear, *straight;
    const f64 *matrix;
} Look;

/* Where a texture is looked up: the index of its lower texel, and the shares of the next texels. */
typedef struct {
    i64 x, y;
    f64 fx, fy;
} Place;

static Place place_of(const Look *look, const f32 *uv) {
    f64 x = (f64)uv[0] * (f64)look->width, y = (1.0 - (f64)uv[1]) * (f64)look->height;
    if (!(fabs(x) < 1e9 && fabs(y) < 1e9)) x = 0.0, y = 0.0;
    if (look->closest) x = floor(x), y = floor(y);
    else x = x - 0.5, y = y - 0.5;
    return (Place){(i64)floor(x), (i64)floor(y), x - floor(x), y - floor(y)};
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
