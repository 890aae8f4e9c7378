/* Finds the bodies of the certificate: instances that are convex, and triangles that lie in one plane (certificate.py). */
#include <stdlib.h>

#include "certificate.h"

/* Returns whether an instance with triangles begin..end and vertices low..high seems convex. About eight triangles
   are tested: each must have no vertex on one of its sides. No triangle may be a needle. */
static int seems_convex(const f32 *vertices, const i32 *triangles, i64 begin, i64 end, i64 low, i64 high) {
    for (i64 t = begin; t < end; t += (end - begin + 7) / 8) {
        Plane p = plane_of(vertices, triangles + 3 * t);
        int above = 0, below = 0;
        for (i64 n = low; n < high; n++) {
            f64 q = height_above(&p, vertices + 3 * n);
            above |= q > 2 * FLAT, below |= q < -2 * FLAT;
            if (above && below) return 0;
        }
    }
    f64 thinnest = 1.0;
    for (i64 t = begin; t < end; t++) thinnest = least(thinnest, plane_of(vertices, triangles + 3 * t).height);
    return thinnest > NEEDLE;
}

/* The planes found so far: the key of each, and the triangle that represents it. */
typedef struct {
    i64 size, count, *keys;
    i32 *near;
} Planes;

static int grow(Planes *p) {
    i64 size = p->size ? 2 * p->size : 1024;
    i64 *keys = malloc((size_t)size * sizeof *keys);
    i32 *near = malloc((size_t)size * sizeof *near);
    if (!keys || !near) {
        free(keys), free(near);
        return 0;
    }
    for (i64 k = 0; k < size; k++) keys[k] = -1;
    certificate_grown(p->size, size, p->keys, p->near, keys, near);
    free(p->keys), free(p->near);
    p->size = size, p->keys = keys, p->near = near;
    return 1;
}

/* Returns a key of a plane; it is mostly the same for planes that are hardly apart. */
static i64 key_of_plane(Plane p) {
    f64 sign = p.n[0] + p.n[1] * 0.7 + p.n[2] * 0.4 < 0.0 ? -1.0 : 1.0;
    f64 parts[4] = {sign * p.n[0] * 0x1p12, sign * p.n[1] * 0x1p12, sign * p.n[2] * 0x1p12, sign * p.d * 0x1p20};
    u64 key = 0;
    for (int j = 0; j < 4; j++) key = (key * 0x9E3779B1u + (u64)(i64)floor(parts[j] + 0.31)) & (((u64)1 << 62) - 1);
    return (i64)key;
}

/* The triangle that stands for the plane of triangle t, t itself if it is new. Of planes that share a key all but the
   first are lost. */
static i64 stands_for(Planes *planes, i64 key, i64 t) {
    i64 slot = slot_of(planes->size, planes->keys, key);
    if (planes->keys[slot] < 0) {
        planes->keys[slot] = key, planes->near[slot] = (i32)t;
        planes->count++;
    }
    return planes->near[slot];
}

/* Returns whether triangle t, whose plane is p, lies in the plane of triangle u. reach: within this distance the two
   planes must agree up to rounding. */
static int in_plane(const f32 *vertices, const i32 *triangles, i64 t, Plane p, i64 u, f64 reach) {
    Plane o = plane_of(vertices, triangles + 3 * u);
    f64 sign = dot(p.n, o.n) < 0.0 ? -1.0 : 1.0, off = 0.0;
    for (int j = 0; j < 3; j++) off += square(p.n[j] - sign * o.n[j]);
    int flat = off * 4.0 * reach * reach <= FLAT * FLAT;
    for (int k = 0; k < 3; k++) flat &= fabs(height_above(&o, vertices + 3 * (i64)triangles[3 * t + k])) <= FLAT;
    return flat;
}

/* Fills body and clear for those of the instances from number `from` on that seem convex, with the range low..high of
   their vertices and their number of boxes of GROUP·GROUP vertices; the number is 0 for all others. */
KERNEL(certificate_convex,
       SURFACES "ends i64[e]  from i64  body i32[t]!  clear u8[t]!  low i64[k]!  high i64[k]!  boxes i64[k]!"
       ";  0<=ends<=t  rising(ends);  0<=triangles<v")
i64 certificate_convex(i64 v, i64 t, i64 e, i64 k, const f32 *vertices, const i32 *triangles, const i64 *ends, i64 from,
                       i32 *body, u8 *clear, i64 *low, i64 *high, i64 *boxes) {
    (void)t;
    for (i64 i = 0; i + 1 < e && i < k; i++) {
        i64 begin = ends[i], end = ends[i + 1];
        boxes[i] = 0;
        if (end == begin) continue;
        low[i] = v, high[i] = 0;
        for (i64 c = 3 * begin; c < 3 * end; c++) {
            low[i] = triangles[c] < low[i] ? triangles[c] : low[i];
            high[i] = triangles[c] + 1 > high[i] ? triangles[c] + 1 : high[i];
        }
        if (!seems_convex(vertices, triangles, begin, end, low[i], high[i])) continue;
        for (i64 c = begin; c < end; c++) body[c] = (i32)(from + i), clear[c] = UNSURE;
        boxes[i] = (high[i] - low[i] + GROUP * GROUP - 1) / (GROUP * GROUP);
    }
    return 0;
}

/* Names of the planes of triangles begin..end; −1: of a convex instance, or too thin. */
KERNEL(certificate_keys, SURFACES "begin i64  end i64  body i32[t]  keys i64[t]!"
       ";  0<=begin;  0<=triangles<v")
i64 certificate_keys(i64 v, i64 t, const f32 *vertices, const i32 *triangles, i64 begin, i64 end, const i32 *body,
                     i64 *keys) {
    (void)v;
    for (i64 k = begin; k < end && k < t; k++) {
        Plane p = plane_of(vertices, triangles + 3 * k);
        keys[k] = body[k] < 0 && p.height > NEEDLE ? key_of_plane(p) : -1;
    }
    return 0;
}

/* Fills body and clear of what lies in one plane, of the names whose turn it is: number `part` of `parts`. body: from
   `first` on. Returns 1 where memory is lacking. */
KERNEL(certificate_planes,
       SURFACES "keys i64[t]  part i64  parts i64  reach f64  first i64  body i32[t]!  clear u8[t]!"
       ";  0<parts;  0<=triangles<v")
i64 certificate_planes(i64 v, i64 t, const f32 *vertices, const i32 *triangles, const i64 *keys, i64 part, i64 parts,
                       f64 reach, i64 first, i32 *body, u8 *clear) {
    Planes planes = {0};
    int some = grow(&planes);
    (void)v;
    for (i64 k = 0; k < t && some; k++) {
        if (keys[k] < 0 || (keys[k] ^ keys[k] >> 31) % parts != part) continue;
        i64 u = stands_for(&planes, keys[k], k);
        if (in_plane(vertices, triangles, k, plane_of(vertices, triangles + 3 * k), u, reach))
            body[k] = (i32)(first + u), clear[k] = ABOVE | BELOW;
        some = 2 * planes.count <= planes.size || grow(&planes);
    }
    free(planes.keys), free(planes.near);
    return !some;
}

typedef struct {
    i64 place, vertex;
} Ordered;

static int by_place(const void *a, const void *b) {
    const Ordered *x = a, *y = b;
    return x->place != y->place ? (x->place > y->place) - (x->place < y->place) : (x->vertex > y->vertex) - (x->vertex < y->vertex);
}

/* Copies the vertices of the convex instances, sorted so that neighbours in space are adjacent: by the interleaved
   bits of x, y and z (Morton order). The last boxes are filled up with the last vertex. Returns 1 if there is not
   enough memory. */
KERNEL(certificate_sorted, "vertices f32[v,3]  low i64[k]  high i64[k]  first i64[e]  out f64[3,n]!"
       ";  0<=first<=n/64")
i64 certificate_sorted(i64 v, i64 instances, i64 e, i64 n, const f32 *vertices, const i64 *low, const i64 *high, const i64 *first,
                       f64 *out) {
    Ordered *own = malloc((size_t)(v ? v : 1) * sizeof *own);
    if (!own) return 1;
    for (i64 i = 0; i < instances && i + 1 < e; i++) {
        f64 floor_of[3], size = 1e-30;
        i64 count = high[i] - low[i];
        if (first[i + 1] <= first[i]) continue;
        if (low[i] < 0 || high[i] > v || count <= 0) return OUTSIDE;
        for (int j = 0; j < 3; j++) {
            f64 a = INFINITY, b = -INFINITY;
            for (i64 k = low[i]; k < high[i]; k++) a = least(a, vertices[3 * k + j]), b = most(b, vertices[3 * k + j]);
            floor_of[j] = a, size = most(size, b - a);
        }
        for (i64 k = 0; k < count; k++) {
            own[k] = (Ordered){0, low[i] + k};
            for (int j = 0; j < 3; j++) {
                i64 x = (i64)((vertices[3 * (low[i] + k) + j] - floor_of[j]) / size * 1023.0);
                for (int b = 0; b < 10; b++) own[k].place |= (x >> b & 1) << (3 * b + j);
            }
        }
        qsort(own, (size_t)count, sizeof *own, by_place);
        for (i64 k = GROUP * GROUP * first[i]; k < GROUP * GROUP * first[i + 1]; k++) {
            i64 at = k - GROUP * GROUP * first[i], from = own[at < count ? at : count - 1].vertex;
            for (int j = 0; j < 3; j++) out[j * n + k] = vertices[3 * from + j];
        }
    }
    free(own);
    return 0;
}

/* Computes the centre and half the size of boxes around `group` vertices each. */
KERNEL(certificate_boxes, "vertices f64[3,n]  group i64  boxes f64[b,2,3]!"
       ";  0<group")
i64 certificate_boxes(i64 n, i64 b, const f64 *vertices, i64 group, f64 *boxes) {
    for (i64 k = 0; k < b; k++)
        for (int j = 0; j < 3; j++) {
            f64 low = INFINITY, high = -INFINITY;
            for (i64 at = group * k; at < n && at < group * k + group; at++)
                low = least(low, vertices[j * n + at]), high = most(high, vertices[j * n + at]);
            boxes[6 * k + j] = (high + low) / 2, boxes[6 * k + 3 + j] = (high - low) / 2 + 1e-9;
        }
    return 0;
}
