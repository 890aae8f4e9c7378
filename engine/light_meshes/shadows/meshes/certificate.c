/* Finds receivers for which every candidate is visible without a ray (certificate.py). Coordinates are those of the
   tracer's frame. */
#include <stdlib.h>

#include "../../rays/triangles.h"

#define ULP 0x1p-23
#define FLAT ULP  /* how far a triangle's vertices may be from its plane, because they are rounded */
/* the ratio of a triangle's height to its length; for thinner ones Embree's plane may be a different one */
#define NEEDLE 1e-4
enum { GROUP = 8, MOST = 512 };
enum { ABOVE = 1, BELOW = 2, UNSURE = 255 };
enum { SEVERAL = -2, UNKNOWN = -3, NONE = -4 };

#define SURFACES "vertices f32[v,3]  triangles i32[t,3]  "

static f64 least(f64 a, f64 b) { return b < a ? b : a; }
static f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* The unit normal and the offset of a triangle's plane, and the ratio of its height to its length. */
typedef struct {
    f64 n[3], d, height;
} Plane;

static Plane plane_of(const f32 *vertices, const i32 *triangle) {
    Edges s = edges_of(vertices, triangle);
    f64 g[3] = {s.e[0] - s.f[0], s.e[1] - s.f[1], s.e[2] - s.f[2]};
    Plane p;
    cross(s.e, s.f, p.n);
    f64 length = sqrt(dot(p.n, p.n));
    for (int j = 0; j < 3; j++) p.n[j] /= length;
    p.d = dot(p.n, s.a);
    p.height = length / most(most(dot(s.e, s.e), dot(s.f, s.f)), dot(g, g));
    return p;
}

static f64 height_above(const Plane *p, const f32 *vertex) {
    return p->n[0] * vertex[0] + p->n[1] * vertex[1] + p->n[2] * vertex[2] - p->d;
}

/* Returns the slot of a key in a hash table of cells or planes; −1 marks a free slot. */
static i64 slot_of(i64 size, const i64 *keys, i64 key) {
    u64 mask = (u64)size - 1, x = (u64)key * SPREAD, slot = (x ^ x >> 32) & mask;
    while (keys[slot] != key && keys[slot] >= 0) slot = (slot + 1) & mask;
    return (i64)slot;
}

KERNEL(certificate_grown, "keys i64[n]  values i32[n]  more i64[m]!  moved i32[m]!")
i64 certificate_grown(i64 n, i64 m, const i64 *keys, const i32 *values, i64 *more, i32 *moved) {
    for (i64 k = 0; k < n; k++)
        if (keys[k] >= 0) {
            i64 slot = slot_of(m, more, keys[k]);
            more[slot] = keys[k], moved[slot] = values[k];
        }
    return 0;
}

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
       SURFACES "ends i64[e]  from i64  body i32[t]!  clear u8[t]!  low i64[k]!  high i64[k]!  boxes i64[k]!")
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
KERNEL(certificate_keys, SURFACES "begin i64  end i64  body i32[t]  keys i64[t]!")
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
       SURFACES "keys i64[t]  part i64  parts i64  reach f64  first i64  body i32[t]!  clear u8[t]!")
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
KERNEL(certificate_sorted, "vertices f32[v,3]  low i64[k]  high i64[k]  first i64[e]  out f64[3,n]!")
i64 certificate_sorted(i64 v, i64 instances, i64 e, i64 n, const f32 *vertices, const i64 *low, const i64 *high, const i64 *first,
                       f64 *out) {
    Ordered *own = malloc((size_t)(v ? v : 1) * sizeof *own);
    if (!own) return 1;
    for (i64 i = 0; i < instances && i + 1 < e; i++) {
        f64 floor_of[3], size = 1e-30;
        i64 count = high[i] - low[i];
        if (first[i + 1] == first[i]) continue;
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
KERNEL(certificate_boxes, "vertices f64[3,n]  group i64  boxes f64[b,2,3]!")
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

/* The convex instances, in two levels of boxes. */
typedef struct {
    i64 n;
    const f64 *vertices, *boxes, *larger;
    const i64 *first;
} Convex;

/* Returns whether something in the box may be above the plane, or below it, on a side for which this is not known
   yet. */
static int crosses(const f64 *box, const Plane *p, int above, int below) {
    f64 middle = dot(p->n, box) - p->d;
    f64 half = fabs(p->n[0]) * box[3] + fabs(p->n[1]) * box[4] + fabs(p->n[2]) * box[5];
    return (middle + half > 2 * FLAT && !above) || (middle - half < -2 * FLAT && !below);
}

/* Returns the sides of a triangle of instance i on which no vertex of the instance is; 0 if the test would take too
   long. */
static u8 sides_of(const f32 *vertices, const i32 *triangle, i64 i, const Convex *convex) {
    Plane p = plane_of(vertices, triangle);
    const f64 *x = convex->vertices, *y = x + convex->n, *z = y + convex->n;
    int above = 0, below = 0, asked = 0;
    for (i64 g = convex->first[i]; g < convex->first[i + 1]; g++) {
        if (!crosses(convex->larger + 6 * g, &p, above, below)) continue;
        for (i64 b = GROUP * g; b < GROUP * g + GROUP; b++) {
            if (!crosses(convex->boxes + 6 * b, &p, above, below)) continue;
            int over = 0, under = 0;
            for (i64 n = GROUP * b; n < GROUP * b + GROUP; n++) {  /* no branch, so that several are computed at once */
                f64 q = p.n[0] * x[n] + p.n[1] * y[n] + p.n[2] * z[n] - p.d;
                over += q > 2 * FLAT, under += q < -2 * FLAT;
            }
            above |= over > 0, below |= under > 0;
            asked++;
        }
        if (asked > MOST) return 0;
    }
    return (u8)((above ? 0 : ABOVE) | (below ? 0 : BELOW));
}

/* Estimates how many cells the triangles fill, times 1000. */
KERNEL(certificate_about, SURFACES "wanted i64[w]  cell f64  total f64[1]!")
i64 certificate_about(i64 v, i64 t, i64 w, const f32 *vertices, const i32 *triangles, const i64 *wanted, f64 cell,
                      f64 *total) {
    (void)v, (void)t;
    *total = 0.0;
    for (i64 k = 0; k < w; k++) {
        Edges s = edges_of(vertices, triangles + 3 * wanted[k]);
        f64 normal[3], length = 0.0;
        cross(s.e, s.f, normal);
        for (int j = 0; j < 3; j++)
            length = most(length, most(most(s.e[j], s.f[j]), 0.0) - least(least(s.e[j], s.f[j]), 0.0));
        *total += sqrt(dot(normal, normal)) / (cell * cell) + (length > cell ? length / cell : 0.0);
    }
    return 0;
}

/* Returns the key of cell (i,j,k), each within ±2²⁰. */
static i64 key_of(i64 i, i64 j, i64 k) {
    i64 half = (i64)1 << 20;
    return (i + half) << 42 | (j + half) << 21 | (k + half);
}

/* Cuts a triangle through the middle of its longest edge; `other` is the second half. */
static void halve(f64 piece[3][3], f64 other[3][3]) {
    f64 longest = -1.0;
    int at = 0;
    for (int k = 0; k < 3; k++) {
        f64 q = squared_distance(piece[(k + 1) % 3], piece[k]);
        if (q > longest) longest = q, at = k;
    }
    int to = (at + 1) % 3;
    for (int j = 0; j < 3; j++) {
        f64 middle = (piece[at][j] + piece[to][j]) / 2;
        other[at][j] = middle, other[to][j] = piece[to][j], other[3 - at - to][j] = piece[3 - at - to][j];
        piece[to][j] = middle;
    }
}

/* The cells that a piece of a triangle may touch. */
typedef struct {
    i64 low[3], high[3];
    f64 cells;
    int beyond;
} Cells;

static Cells cells_of(f64 piece[3][3], f64 limit) {
    Cells c = {.cells = 1.0};
    for (int j = 0; j < 3; j++) {
        f64 low = least(least(piece[0][j], piece[1][j]), piece[2][j]), high = most(most(piece[0][j], piece[1][j]), piece[2][j]);
        c.beyond |= low > limit || high < -limit;
        low = floor(low - 1e-6), high = floor(high + 1e-6);
        c.cells *= high - low + 1.0;
        c.low[j] = (i64)low, c.high[j] = (i64)high;
    }
    return c;
}

/* Enters the body `whose` into cells; *count grows. Returns 0 if the table is half full. */
static int enter(Cells c, i32 whose, i64 size, i64 *keys, i32 *only, i64 *count) {
    for (i64 i = c.low[0]; i <= c.high[0]; i++)
        for (i64 j = c.low[1]; j <= c.high[1]; j++)
            for (i64 k = c.low[2]; k <= c.high[2]; k++) {
                i64 key = key_of(i, j, k), slot = slot_of(size, keys, key);
                if (keys[slot] >= 0) {
                    if (only[slot] != whose) only[slot] = SEVERAL;
                    continue;
                }
                if (2 * *count > size) return 0;
                (*count)++;
                keys[slot] = key, only[slot] = whose >= 0 ? whose : SEVERAL;
            }
    return 1;
}

/* Enters the triangles `wanted`, from number state[0] on, into the grid within ±limit. Large triangles are halved
   until the box of each part covers only a few cells. Stops early if the table is half full: then state[0] is the
   triangle with which to continue in a larger table, and state[1] is the number of cells. */
KERNEL(certificate_fill,
       SURFACES "wanted i64[w]  body i32[t]  cell f64  limit f64  state i64[2]!  keys i64[s]!  only i32[s]!")
i64 certificate_fill(i64 v, i64 t, i64 w, i64 s, const f32 *vertices, const i32 *triangles, const i64 *wanted,
                     const i32 *body, f64 cell, f64 limit, i64 *state, i64 *keys, i32 *only) {
    f64 stack[256][3][3];
    Cells last = {0};
    i32 whose = SEVERAL;
    int any = 0;
    (void)v, (void)t;
    for (; state[0] < w; state[0]++) {
        i64 own = wanted[state[0]], left = 1;
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 3; j++) stack[0][k][j] = vertices[3 * (i64)triangles[3 * own + k] + j] / cell;
        while (left) {
            left--;
            Cells c = cells_of(stack[left], limit / cell);
            if (c.beyond) continue;
            if (c.cells > 8.0) {
                halve(stack[left], stack[left + 1]);
                left += 2;
                continue;
            }
            if (any && whose == body[own] && !memcmp(c.low, last.low, sizeof c.low) && !memcmp(c.high, last.high, sizeof c.high))
                continue;  /* neighbouring triangles often touch the same cells */
            whose = body[own], last = c, any = 1;
            if (!enter(c, whose, s, keys, only, state + 1)) return 0;
        }
    }
    return 0;
}

/* Returns the only body in cell (i,j,k) and the 26 around it, SEVERAL, or NONE. */
static i32 around_of(i64 size, const i64 *keys, const i32 *only, i64 i, i64 j, i64 k) {
    i32 one = NONE;
    for (i64 a = i - 1; a <= i + 1; a++)
        for (i64 b = j - 1; b <= j + 1; b++)
            for (i64 c = k - 1; c <= k + 1; c++) {
                i64 slot = slot_of(size, keys, key_of(a, b, c));
                if (keys[slot] < 0) continue;
                if (only[slot] == SEVERAL || (one != NONE && one != only[slot])) return SEVERAL;
                one = only[slot];
            }
    return one;
}

/* Marks receivers, on the side N of their triangle, that see all nodes that are more than MARGIN above it within r.
   Several threads may write to `around` and `clear`; they all write the same values. */
KERNEL(certificate_holds,
       "centre f64[3]  scale f64  reach f64  " SURFACES "instance i32[t]  cell f64  body i32[t]  clear u8[t]!  "
       "corners f64[3,c]  boxes f64[b,2,3]  larger f64[g,2,3]  first i64[e]  keys i64[s]  only i32[s]  around i32[s]!  "
       "P f64[n,3]  N f64[n,3]  triangle i32[n]  out bool[n]!")
i64 certificate_holds(i64 v, i64 t, i64 c, i64 b, i64 g, i64 e, i64 s, i64 n, const f64 *centre, f64 scale, f64 reach,
                      const f32 *vertices, const i32 *triangles, const i32 *instance, f64 cell, const i32 *body,
                      u8 *clear, const f64 *corners, const f64 *boxes, const f64 *larger, const i64 *first,
                      const i64 *keys, const i32 *only, i32 *around, const f64 *P, const f64 *N, const i32 *triangle,
                      u8 *out) {
    Convex convex = {c, corners, boxes, larger, first};
    i64 last = -1, place[3] = {0}, before[3];
    (void)v, (void)t, (void)b, (void)g, (void)e;
    for (i64 p = 0; p < n; p++) {
        i64 on = triangle[p];
        /* The receiver's cell; the answer of the receiver before is used again if it is the same */
        int outside = 0;
        memcpy(before, place, sizeof place);
        for (int j = 0; j < 3; j++) {
            f64 x = (P[3 * p + j] - centre[j]) / scale;
            outside |= reach > 1.0 && fabs(P[3 * p + j] - centre[j]) > scale;
            place[j] = outside ? 0 : (i64)floor(x / cell);
        }
        if (outside) {
            out[p] = 0, last = -1;
            continue;
        }
        if (last >= 0 && on == triangle[last] && !memcmp(place, before, sizeof place) &&
            !memcmp(N + 3 * p, N + 3 * last, 3 * sizeof *N)) {
            out[p] = out[last];  /* neighbouring triangles often touch the same cells */
            continue;
        }
        last = p;
        /* The only body in the cells around it */
        i64 slot = slot_of(s, keys, key_of(place[0], place[1], place[2]));
        i32 one = keys[slot] < 0 ? UNKNOWN : around[slot];
        if (one == UNKNOWN) {
            one = around_of(s, keys, only, place[0], place[1], place[2]);
            if (keys[slot] >= 0) around[slot] = one;
        }
        out[p] = one == NONE;
        if (one < 0 || one != body[on]) continue;
        /* It is the receiver's own: is its side of the triangle clear of this body? */
        Edges edge = edges_of(vertices, triangles + 3 * on);
        f64 normal[3];
        cross(edge.e, edge.f, normal);
        if (clear[on] == UNSURE) clear[on] = sides_of(vertices, triangles + 3 * on, instance[on], &convex);
        out[p] = (clear[on] & (dot(normal, N + 3 * p) > 0.0 ? ABOVE : BELOW)) != 0;
    }
    return 0;
}
