/* Finds receivers for which every candidate is visible without a ray: the grid of the bodies that are near them
   (certificate.py). */
#include "certificate.h"

KERNEL(certificate_grown, "keys i64[n]  values i32[n]  more i64[m]!  moved i32[m]!"
       ";  power(m)  n<m")
i64 certificate_grown(i64 n, i64 m, const i64 *keys, const i32 *values, i64 *more, i32 *moved) {
    for (i64 k = 0; k < n; k++)
        if (keys[k] >= 0) {
            i64 slot = slot_of(m, more, keys[k]);
            more[slot] = keys[k], moved[slot] = values[k];
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
KERNEL(certificate_about, SURFACES "wanted i64[w]  cell f64  total f64[1]!"
       ";  0<=wanted<t  0<cell<inf;  0<=triangles<v")
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
       SURFACES "wanted i64[w]  body i32[t]  cell f64  limit f64  state i64[2]!  keys i64[s]!  only i32[s]!"
       ";  power(s)  0<=wanted<t  0<cell<inf  0<limit  0<=state;  0<=triangles<v")
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
            if (c.cells > 8.0 && left < 255) {
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
       "P f64[n,3]  N f64[n,3]  triangle i32[n]  out bool[n]!"
       ";  power(s)  b=8*g  c=8*b  0<cell<inf  0<=triangle<t;  0<=triangles<v  0<=instance<e-1  0<=first<=g")
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
