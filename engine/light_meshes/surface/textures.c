/* Image textures (textures.py). */
#include "texels.h"

/* Fills alpha with the share of a clipped image's texels at uv that are inside. */
KERNEL(textures_coverage, "height i64  width i64  interpolation i64  uv f32[n,2]  alpha f64[n,one]!"
       ";  0<height  0<width  1<=one")
i64 textures_coverage(i64 n, i64 one, i64 height, i64 width, i64 interpolation, const f32 *uv, f64 *alpha) {
    Look look = {.height = height, .width = width, .interpolation = interpolation};
    for (i64 k = 0; k < n; k++) alpha[one * k] = coverage_at(&look, uv + 2 * k);
    return 0;
}

/* Fills out with the texels that count at uv[rows]: row · width + column; −1: none. */
KERNEL(textures_needed, "height i64  width i64  interpolation i64  extension i64  uv f32[n,2]  rows i64[r]  out i64[r,s]!"
       ";  0<height  0<width  interpolation=2|s=4  s=4|s=16  0<=rows<n")
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
#define KIND U8
#define TABLE "l=0|256<=l"
#define NAME(kernel) kernel##_u8
#include "textures_look.h"
#undef T
#undef T_NAME
#undef KIND
#undef TABLE
#undef NAME
#define T u16
#define T_NAME "u16"
#define KIND U16
#define TABLE "l=0|65536<=l"
#define NAME(kernel) kernel##_u16
#include "textures_look.h"
#undef T
#undef T_NAME
#undef KIND
#undef TABLE
#undef NAME
#define T f32
#define T_NAME "f32"
#define KIND F32
#define TABLE "l=0"
#define NAME(kernel) kernel##_f32
#include "textures_look.h"
