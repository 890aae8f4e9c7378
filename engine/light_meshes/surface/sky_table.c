/* Radiance by direction in square tables of equal solid angles, one half the size of the other (sky_table.py). */
#include "native.h"

/* Where the unit direction d is on the square, 0 to 1 (Clarberg 2008: octahedral, and areas keep their shares). */
static void place_of(const f64 *d, f64 *x, f64 *y) {
    f64 r = sqrt(fmax(1.0 - fabs(d[2]), 0.0)), a = fabs(d[0]), b = fabs(d[1]);
    f64 v = a + b > 0.0 ? atan2(b, a) * (2.0 / PI) * r : 0.0, u = r - v;
    if (d[2] < 0.0) {
        f64 other = 1.0 - u;
        u = 1.0 - v, v = other;
    }
    *x = 0.5 + copysign(0.5 * u, d[0]), *y = 0.5 + copysign(0.5 * v, d[1]);
    if (!(*x >= 0.0 && *x <= 1.0 && *y >= 0.0 && *y <= 1.0)) *x = *y = 0.5;  /* d is no unit vector */
}

/* The texel (i, j) of a table of size² texels, or the one that is there beyond an edge, as the sphere is folded. */
static const f32 *texel(const f32 *table, i64 size, i64 i, i64 j) {
    if (i < 0 || i >= size) i = i < 0 ? -1 - i : 2 * size - 1 - i, j = size - 1 - j;
    if (j < 0 || j >= size) j = j < 0 ? -1 - j : 2 * size - 1 - j, i = size - 1 - i;
    return table + 3 * (j * size + i);
}

/* Adds weight × the table's value at (x, y) between its four texels. */
static void add(const f32 *table, i64 size, f64 x, f64 y, f64 weight, f64 *out) {
    x = x * (f64)size - 0.5, y = y * (f64)size - 0.5;
    f64 fx = x - floor(x), fy = y - floor(y);
    i64 i = (i64)floor(x), j = (i64)floor(y);
    for (int corner = 0; corner < 4; corner++) {
        const f32 *value = texel(table, size, i + (corner & 1), j + (corner >> 1));
        f64 share = weight * (corner & 1 ? fx : 1.0 - fx) * (corner >> 1 ? fy : 1.0 - fy);
        for (int c = 0; c < 3; c++) out[c] += share * (f64)value[c];
    }
}

/* Sets out to the radiance from unit directions. texels: of all tables, the largest (size²) first, each half as long
   and wide as the one before. level: which table, with what is between; of each direction, or one for all. */
KERNEL(sky_table_look, "texels f32[t,3]  size i64  direction f64[n,3]  level f64[m]  out f64[n,3]!"
       ";  m=n|m=1  1<=size  size*size<=t")
i64 sky_table_look(i64 t, i64 n, i64 m, const f32 *texels, i64 size, const f64 *direction, const f64 *level, f64 *out) {
    i64 first[64], last = 0;
    first[0] = 0;
    for (i64 s = size; s > 1 && first[last] + s * s < t; s /= 2, last++) first[last + 1] = first[last] + s * s;
    for (i64 k = 0; k < n; k++) {
        f64 x, y, wanted = level[m > 1 ? k : 0];
        f64 *own = out + 3 * k;
        wanted = !(wanted > 0.0) ? 0.0 : wanted < (f64)last ? wanted : (f64)last;
        i64 l = (i64)wanted;
        f64 between = wanted - (f64)l;
        place_of(direction + 3 * k, &x, &y);
        own[0] = own[1] = own[2] = 0.0;
        add(texels + 3 * first[l], size >> l, x, y, 1.0 - between, own);
        if (between > 0.0) add(texels + 3 * first[l + 1], size >> (l + 1), x, y, between, own);
    }
    return 0;
}
