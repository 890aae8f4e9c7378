/* S of receivers from the rays of their neighbours in the picture, where penumbrae are wide (blocks.py). */
#include <stdlib.h>

#include "targets.h"

enum { ACROSS = 8, SIDE = 2 * ACROSS, PIXELS = SIDE * SIDE, WITH_EDGE = SIDE + 1, PLANES = 8, WINDOWS = 4 };

static i64 large(i64 place) { return place >> 8; }

/* The pixel of a large block that a receiver is in; edge: how many pixels a small block is wide. */
static i64 pixel_of(i64 place, i64 edge) {
    i64 x = (place >> 6 & 1) * edge + (place & 7), y = (place >> 7 & 1) * edge + (place >> 3 & 7);
    return SIDE * y + x;
}

/* Which planes the receivers of each large block are on: numbers below PLANES, which have a meaning in that block only, or
   PLANES. Receivers are on one plane if their normals differ by less than 14°, and if they lie in it to half of that. */
KERNEL(blocks_planes, "place i64[n]  P f64[n,3]  N f64[n,3]  plane u8[n]!")
i64 blocks_planes(i64 n, const i64 *place, const f64 *P, const f64 *N, u8 *plane) {
    i64 first[PLANES], count = 0;
    for (i64 p = 0; p < n; p++) {
        if (!p || large(place[p]) != large(place[p - 1])) count = 0;
        i64 k = 0;
        for (; k < count; k++) {
            const f64 *normal = N + 3 * first[k], *at = P + 3 * first[k];
            f64 d[3] = {P[3 * p] - at[0], P[3 * p + 1] - at[1], P[3 * p + 2] - at[2]}, high = dot(d, normal);
            if (dot(N + 3 * p, normal) >= 0.97 && high * high <= 0.016 * dot(d, d)) break;
        }
        if (k == count && count < PLANES) first[count++] = p;
        plane[p] = (u8)k;
    }
    return 0;
}

/* Sums over what the receivers of one plane found: their number, that of those with others in their pixel, the shares that
   they see, by how much these differ within pixels, their places with their squares, and with their places what arrives of
   the light and what would if nothing stood between. */
enum { RAYS, SEVERAL, SEEN, DIFFER, AT_X, AT_Y, XX, XY, YY, CLEAR, CLEAR_X, CLEAR_Y, WHOLE, WHOLE_X, WHOLE_Y, NUMBERS };

typedef struct {
    f64 of[NUMBERS];
} Sums;

typedef struct {
    i64 x0, y0, x1, y1;
} Box;

/* Those of one plane: of pixels, and of all pixels above and left of each corner in the box where it is. */
typedef struct {
    Sums pixel[PIXELS], before[WITH_EDGE * WITH_EDGE];
    f64 found[PIXELS];
    Box box;
} Plane;

static void clear_plane(Plane *p) {
    memset(p->pixel, 0, sizeof p->pixel);
    p->box = (Box){SIDE, SIDE, 0, 0};
}

static void widen(Box *b, i64 x, i64 y) {
    if (x < b->x0) b->x0 = x;
    if (y < b->y0) b->y0 = y;
    if (x >= b->x1) b->x1 = x + 1;
    if (y >= b->y1) b->y1 = y + 1;
}

static void add_up(Plane *p, f64 each) {
    Box b = p->box;
    for (i64 x = b.x0; x <= b.x1; x++) memset(p->before + WITH_EDGE * b.y0 + x, 0, sizeof *p->before);
    for (i64 y = b.y0; y < b.y1; y++) {
        Sums row = {{0.0}};
        memset(p->before + WITH_EDGE * (y + 1) + b.x0, 0, sizeof *p->before);
        for (i64 x = b.x0; x < b.x1; x++) {
            f64 *at = p->pixel[SIDE * y + x].of, n = at[RAYS], c = at[CLEAR], w = at[WHOLE], X = (f64)x, Y = (f64)y;
            int several = n > 1.5;
            at[SEVERAL] = several ? n : 0.0;
            at[DIFFER] = several ? each * sqrt(each) * (at[DIFFER] - at[SEEN] * at[SEEN] / n) * n / (n - 1.0) : 0.0;
            at[AT_X] = n * X, at[AT_Y] = n * Y, at[XX] = n * X * X, at[XY] = n * X * Y, at[YY] = n * Y * Y;
            at[CLEAR_X] = c * X, at[CLEAR_Y] = c * Y, at[WHOLE_X] = w * X, at[WHOLE_Y] = w * Y;
            for (int k = 0; k < NUMBERS; k++) {
                row.of[k] += at[k];
                p->before[WITH_EDGE * (y + 1) + x + 1].of[k] = p->before[WITH_EDGE * y + x + 1].of[k] + row.of[k];
            }
        }
    }
}

/* The pixels up to `far` from a pixel, and as many at the block's edge. */
static Box around(i64 x, i64 y, i64 far, i64 side) {
    i64 wide = 2 * far + 1 < side ? 2 * far + 1 : side;
    i64 x0 = x < far ? 0 : x - far, y0 = y < far ? 0 : y - far;
    if (x0 > side - wide) x0 = side - wide;
    if (y0 > side - wide) y0 = side - wide;
    return (Box){x0, y0, x0 + wide, y0 + wide};
}

static i64 clamped(i64 x, i64 low, i64 high) { return x < low ? low : x > high ? high : x; }

static Sums sums_in(const Plane *p, Box b) {
    const Sums *s = p->before;
    Sums found;
    b = (Box){clamped(b.x0, p->box.x0, p->box.x1), clamped(b.y0, p->box.y0, p->box.y1), clamped(b.x1, p->box.x0, p->box.x1),
              clamped(b.y1, p->box.y0, p->box.y1)};
    for (int k = 0; k < NUMBERS; k++)
        found.of[k] = s[WITH_EDGE * b.y1 + b.x1].of[k] - s[WITH_EDGE * b.y0 + b.x1].of[k] - s[WITH_EDGE * b.y1 + b.x0].of[k] +
                      s[WITH_EDGE * b.y0 + b.x0].of[k];
    return found;
}

/* How much of the variance of rays is within pixels; 2 where all agree. */
static f64 share_within(const f64 *s) {
    f64 all = s[SEEN] * (s[RAYS] - s[SEEN]);
    if (!(all > 1e-9 * s[RAYS])) return 2.0;
    return s[SEVERAL] > 0.5 ? s[DIFFER] / s[SEVERAL] * s[RAYS] * s[RAYS] / all : 0.0;
}

/* How S changes from pixel to pixel, by a plane that is fitted to it. */
static void slope_of(const f64 *s, f64 *slope) {
    f64 n = s[RAYS], x = s[AT_X] / n, y = s[AT_Y] / n, value = s[CLEAR] / s[WHOLE], mean = s[WHOLE] / n;
    f64 X = s[XX] - x * s[AT_X], Y = s[YY] - y * s[AT_Y], Z = s[XY] - x * s[AT_Y], det = X * Y - Z * Z;
    f64 p = (s[CLEAR_X] - x * s[CLEAR] - value * (s[WHOLE_X] - x * s[WHOLE])) / mean;
    f64 q = (s[CLEAR_Y] - y * s[CLEAR] - value * (s[WHOLE_Y] - y * s[WHOLE])) / mean;
    int fits = det > 1e-6 * n * n;
    slope[0] = fits ? (p * Y - q * Z) / det : 0.0, slope[1] = fits ? (q * X - p * Z) / det : 0.0;
}

/* What the pixels of a box say of S at x, y. */
static f64 said_by(const Plane *p, Box box, const f64 *slope, i64 x, i64 y, f64 *rays) {
    Sums s = sums_in(p, box);
    *rays = s.of[RAYS];
    return s.of[CLEAR] / s.of[WHOLE] + slope[0] * ((f64)x - s.of[AT_X] / *rays) + slope[1] * ((f64)y - s.of[AT_Y] / *rays);
}

/* Pixels up to `look` from a pixel tell whether the penumbra is wide there: whether at least the share `least` of the variance
   of their rays is within pixels. Then S is the mean of those up to `reach` from there, with the slope of all. */
typedef struct {
    i64 look, reach;
    f64 least;
} Window;

/* S at a pixel by the first window in which the penumbra is wide; negative: in none. What still fewer pixels say must not be
   farther from it than rays do by chance, `surprise` times n^-3/4 of n of them. */
static f64 decided(const Plane *of, i64 x, i64 y, i64 side, f64 each, f64 surprise, i64 windows, const Window *window) {
    for (i64 k = 0; k < windows; k++) {
        Sums far = sums_in(of, around(x, y, window[k].look, side));
        if (share_within(far.of) < window[k].least) continue;
        f64 slope[2], rays;
        slope_of(far.of, slope);
        f64 found = said_by(of, around(x, y, window[k].reach, side), slope, x, y, &rays);
        int sure = 1;
        for (i64 r = 0; sure && r < window[k].reach; r++) {
            Box fewer = {x < r ? 0 : x - r, y < r ? 0 : y - r, x + r < side ? x + r + 1 : side, y + r < side ? y + r + 1 : side};
            f64 other = said_by(of, fewer, slope, x, y, &rays), n = rays * each;
            sure = fabs(other - found) * sqrt(n * sqrt(n)) <= surprise;
        }
        if (sure) return found < 0.0 ? 0.0 : found > 1.0 ? 1.0 : found;
    }
    return -1.0;
}

/* Sets S of the pairs left, light by light with ascending rows, where the penumbra is wide, and their lights' bits in partly;
   moves the others to the front of `left`, and returns how many these are; negative: without memory. windows (w,3): look, reach
   and least of each, the widest first; edge: of small blocks in pixels; each: rays of each pair.
   Where S has several channels, all are left. */
KERNEL(blocks_fitted,
       "edge i64  each f64  surprise f64  windows f64[w,3]  place i64[n]  plane u8[n]  row i32[k]  light i32[k]  have u8[k]  "
       "clear f64[k,C]  whole f64[k]  left i32[m]!  S f32[n,L,C]!  partly u64[n,W]!"
       ";  W=words(L)  0<edge<=8  0<=place  0<=row<n  0<=light<L  0<=left<k")
i64 blocks_fitted(i64 w, i64 n, i64 k, i64 C, i64 m, i64 L, i64 W, i64 edge, f64 each, f64 surprise, const f64 *windows,
                  const i64 *place, const u8 *plane, const i32 *row, const i32 *light, const u8 *have, const f64 *clear,
                  const f64 *whole, i32 *left, f32 *S, u64 *partly) {
    if (C != 1) return m;
    Window window[WINDOWS];
    Plane *planes = malloc(PLANES * sizeof *planes);
    i64 count = 0;
    (void)n, (void)k;
    if (!planes || w > WINDOWS) {
        free(planes);
        return -1;
    }
    for (i64 j = 0; j < w; j++) window[j] = (Window){(i64)windows[3 * j], (i64)windows[3 * j + 1], windows[3 * j + 2]};
    for (i64 first = 0, last; first < m; first = last) {
        i64 block = large(place[row[left[first]]]), i = light[left[first]], used = 0;
        for (last = first; last < m && light[left[last]] == i && large(place[row[left[last]]]) == block; last++) {
            i64 at = left[last], p = row[at], of = plane[p];
            if (of >= PLANES) continue;
            for (; used <= of; used++) clear_plane(planes + used);
            if (!have[at] || !(whole[at] > 0.0)) continue;
            i64 pixel = pixel_of(place[p], edge);
            f64 *to = planes[of].pixel[pixel].of, v = clear[at] / whole[at];
            widen(&planes[of].box, pixel % SIDE, pixel / SIDE);
            to[RAYS] += 1.0, to[SEEN] += v, to[DIFFER] += v * v, to[CLEAR] += clear[at], to[WHOLE] += whole[at];
        }
        for (i64 j = 0; j < used; j++) {
            Plane *of = planes + j;
            add_up(of, each);
            for (i64 q = 0; q < PIXELS; q++)
                of->found[q] = of->pixel[q].of[RAYS] > 0.0
                                   ? decided(of, q % SIDE, q / SIDE, 2 * edge, each, surprise, w, window) : -1.0;
        }
        for (i64 q = first; q < last; q++) {
            i64 at = left[q], p = row[at];
            f64 value = plane[p] < PLANES ? planes[plane[p]].found[pixel_of(place[p], edge)] : -1.0;
            if (value < 0.0) {
                left[count++] = (i32)at;
                continue;
            }
            S[L * p + i] = (f32)value;
            partly[W * p + (i >> 6)] |= bit(i);
        }
    }
    free(planes);
    return count;
}
