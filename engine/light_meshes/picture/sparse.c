/* Light at sparse points of the picture, interpolated (sparse.py). */
#include "../rays/triangles.h"

static const f64 NORMAL = 0.9, AWAY = 0.1, LOBE = 0.2;

static f64 most(f64 a, f64 b) { return b > a ? b : a; }
static f64 least(f64 a, f64 b) { return b < a ? b : a; }

/* Fills film, in pixels, and left: the rows that are less than `reach` from their pixel's centre, on surfaces that
   receive soft shadows. Returns how many there are. view: the camera's first pixel x0, y0 of the tile, its width,
   and the rays per pixel. */
KERNEL(sparse_film,
       "matrix f64[4,4]  window f64[4]  perspective i64  width i64  height i64  P f64[n,3]  triangle i32[n]  "
       "receives bool[t]?  pixel i64[n]  view i64[4]  reach f64  film f64[n,2]!  left i64[n]!"
       ";  ;  t=0|0<=triangle<t")
i64 sparse_film(i64 n, i64 t, const f64 *matrix, const f64 *window, i64 perspective, i64 width, i64 height,
                const f64 *P, const i32 *triangle, const u8 *receives, const i64 *pixel, const i64 *view, f64 reach,
                f64 *film, i64 *left) {
    i64 count = 0, x0 = view[0], y0 = view[1], wide = view[2], per_pixel = view[3];
    (void)t;
    if (wide <= 0 || per_pixel <= 0) return OUTSIDE;
    for (i64 p = 0; p < n; p++) {
        f64 d[3] = {P[3 * p] - matrix[3], P[3 * p + 1] - matrix[7], P[3 * p + 2] - matrix[11]};
        f64 u = matrix[0] * d[0] + matrix[4] * d[1] + matrix[8] * d[2];
        f64 v = matrix[1] * d[0] + matrix[5] * d[1] + matrix[9] * d[2];
        if (perspective) {
            f64 depth = -(matrix[2] * d[0] + matrix[6] * d[1] + matrix[10] * d[2]);
            u = u / depth, v = v / depth;
        }
        f64 x = (u - window[0]) / (window[1] - window[0]) * (f64)width;
        f64 y = (v - window[2]) / (window[3] - window[2]) * (f64)height;
        film[2 * p] = x, film[2 * p + 1] = y;
        i64 place = pixel[p] / per_pixel;
        int near = fabs(x - ((f64)(x0 + place % wide) + 0.5)) < reach && fabs(y - ((f64)(y0 + place / wide) + 0.5)) < reach;
        if (near && (!receives || receives[triangle[p]])) left[count++] = p;
    }
    return count;
}

/* Marks with 0 the points of the grid that are corners of the blocks in which film[left] lies. */
KERNEL(sparse_ask, "film f64[n,2]  left i64[m]  step i64  x0 i64  y0 i64  row i32[h,w]!"
       ";  0<step  0<=left<n")
i64 sparse_ask(i64 n, i64 m, i64 h, i64 w, const f64 *film, const i64 *left, i64 step, i64 x0, i64 y0, i32 *row) {
    (void)n;
    for (i64 k = 0; k < m; k++) {
        i64 p = left[k];
        i64 i = (i64)floor(film[2 * p] / (f64)step - 0.5) - x0, j = (i64)floor(film[2 * p + 1] / (f64)step - 0.5) - y0;
        if (i < 0 || j < 0 || i >= w - 1 || j >= h - 1) return OUTSIDE;
        i32 *at = row + j * w + i;
        at[0] = at[1] = at[w] = at[w + 1] = 0;
    }
    return 0;
}

/* The points of one step (Corners). */
typedef struct {
    i64 wide, terms;
    const i32 *row;
    const f64 *P, *Ng, *Ns, *turned, *light, *rough;
    const i32 *material, *instance;
} Corners;

#define CORNERS                                                                                                     \
    "row i32[h,w]  P f64[c,3]  Ng f64[c,3]  Ns f64[c,3]  material i32[c]  instance i32[c]  turned f64[c,3]  "      \
    "light f64[c,q]  rough f64[c,2]  "
#define OF_CORNERS                                                                                                  \
    const i32 *row, const f64 *P, const f64 *Ng, const f64 *Ns, const i32 *material, const i32 *instance,          \
        const f64 *turned, const f64 *light, const f64 *rough

/* Returns how much four corners differ in diffuse light (kind 0) or gloss (kind 1). */
static f64 spread_of(const Corners *c, const i32 *at, int kind) {
    f64 spread = 0.0, rough = 0.0;
    for (int n = 3 * kind; n < 3 * kind + 3; n++) {
        f64 low = INFINITY, high = -INFINITY;
        for (int k = 0; k < 4; k++) {
            f64 x = c->light[at[k] * c->terms + n];
            low = least(low, x), high = most(high, x);
        }
        spread = most(spread, high - low);
    }
    for (int k = 0; k < 4; k++) rough = most(rough, c->rough[2 * (i64)at[k] + kind]);
    return spread + rough;
}

/* Fills Blocks; largest: the square of the diagonal of the largest block that can be used. */
KERNEL(sparse_agree,
       CORNERS "gloss i64  largest f64  usable bool[H,Z]!  material_of i32[H,Z]!  turn f64[H,Z]!  size f64[H,Z]!  "
               "spread f64[H,Z,2]!"
       ";  H<h  Z<w  3<=q  gloss=0|6<=q  row<c")
i64 sparse_agree(i64 h, i64 w, i64 c, i64 q, i64 H, i64 Z, OF_CORNERS, i64 gloss, f64 largest, u8 *usable,
                 i32 *material_of, f64 *turn, f64 *size, f64 *spread) {
    Corners corners = {w, q, row, P, Ng, Ns, turned, light, rough, material, instance};
    (void)h, (void)c;
    for (i64 j = 0; j < H; j++)
        for (i64 i = 0; i < Z; i++) {
            const i32 *first_row = row + j * w + i;
            const i32 at[4] = {first_row[0], first_row[1], first_row[w], first_row[w + 1]};
            i64 block = j * Z + i, first = at[0];

            /* Do the four corners lie on one instance with nearly the same normal? */
            int good = 1;
            if (at[0] < 0 || at[1] < 0 || at[2] < 0 || at[3] < 0) continue;
            material_of[block] = material[first], turn[block] = 0.0, size[block] = 0.0;
            for (int n = 1; n < 4; n++) {
                i64 k = at[n];
                good &= instance[k] == instance[first] && dot(Ng + 3 * k, Ng + 3 * first) > NORMAL &&
                        dot(Ns + 3 * k, Ns + 3 * first) > NORMAL;
                if (material[k] != material_of[block]) material_of[block] = -1;
                turn[block] = most(turn[block], 1.0 - dot(turned + 3 * k, turned + 3 * first));
            }
            /* How large is the block, and how much do its corners differ? */
            for (int n = 0; n < 2; n++) {
                const f64 *a = P + 3 * (i64)at[n], *b = P + 3 * (i64)at[3 - n];
                f64 d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
                size[block] = most(size[block], dot(d, d));
            }
            usable[block] = good && size[block] <= largest;
            for (int kind = 0; kind < (gloss ? 2 : 1); kind++) spread[2 * block + kind] = spread_of(&corners, at, kind);
        }
    return 0;
}

/* Fills light and done of the rows in `left` for which their block can be used, and rest with the others; returns
   how many others there are. */
KERNEL(sparse_between,
       CORNERS "usable bool[H,Z]  material_of i32[H,Z]  turn f64[H,Z]  size f64[H,Z]  spread f64[H,Z,2]  step i64  x0 i64  "
               "y0 i64  film f64[n,2]  left i64[m]  hit_P f64[n,3]  hit_Ng f64[n,3]  hit_Ns f64[n,3]  hit_material i32[n]  "
               "hit_instance i32[n]  kd f64[M]  ks f64[M]  Os f64[M,3]  nShiny f64[M]  Od f64[n,3]  gloss i64  "
               "tolerance f64  sum f64[n,q]!  done bool[n]!  rest i64[m]!"
       ";  0<step  H<h  Z<w  row<c  0<=left<n  0<=hit_material<M")
i64 sparse_between(i64 h, i64 w, i64 c, i64 q, i64 H, i64 Z, i64 n, i64 m, i64 M, OF_CORNERS, const u8 *usable,
                   const i32 *material_of, const f64 *turn, const f64 *size, const f64 *spread, i64 step, i64 x0,
                   i64 y0, const f64 *film, const i64 *left, const f64 *hit_P, const f64 *hit_Ng, const f64 *hit_Ns,
                   const i32 *hit_material, const i32 *hit_instance, const f64 *kd, const f64 *ks, const f64 *Os,
                   const f64 *nShiny, const f64 *Od, i64 gloss, f64 tolerance, f64 *sum, u8 *done, i64 *rest) {
    i64 count = 0;
    (void)h, (void)c, (void)n, (void)M, (void)material, (void)turned, (void)rough;
    for (i64 index = 0; index < m; index++) {
        i64 p = left[index];
        /* The sample's block, and its place in it */
        f64 x = film[2 * p] / (f64)step - 0.5, y = film[2 * p + 1] / (f64)step - 0.5;
        i64 i = (i64)floor(x), j = (i64)floor(y);
        x = x - (f64)i, y = y - (f64)j, i = i - x0, j = j - y0;
        if (i < 0 || j < 0 || i >= Z || j >= H) return OUTSIDE;
        i64 block = j * Z + i, own = hit_material[p];
        const i32 *first_row = row + j * w + i;
        int good = usable[block];
        /* Is the block good enough for this sample? Then interpolate */
        if (good) {
            const i64 at[4] = {first_row[0], first_row[1], first_row[w], first_row[w + 1]};
            const f64 weight[4] = {(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y};
            f64 off = 0.0, error = spread[2 * block] * kd[own] * most(Od[3 * p], most(Od[3 * p + 1], Od[3 * p + 2]));
            if (gloss && ks[own] > 0.0) {
                error += spread[2 * block + 1] * ks[own] * most(Os[3 * own], most(Os[3 * own + 1], Os[3 * own + 2]));
                good = material_of[block] == own && turn[block] * nShiny[own] <= LOBE;
            }
            for (int k = 0; k < 3; k++) {
                f64 place = weight[0] * P[3 * at[0] + k] + weight[1] * P[3 * at[1] + k] + weight[2] * P[3 * at[2] + k] +
                            weight[3] * P[3 * at[3] + k];
                off += square(place - hit_P[3 * p + k]);
            }
            good = good && error <= tolerance && off <= AWAY * AWAY * size[block] && hit_instance[p] == instance[at[0]] &&
                   dot(hit_Ng + 3 * p, Ng + 3 * at[0]) > NORMAL && dot(hit_Ns + 3 * p, Ns + 3 * at[0]) > NORMAL;
            for (i64 k = 0; good && k < q; k++)
                sum[p * q + k] = weight[0] * light[at[0] * q + k] + weight[1] * light[at[1] * q + k] +
                                 weight[2] * light[at[2] * q + k] + weight[3] * light[at[3] * q + k];
        }
        if (good) done[p] = 1;
        else rest[count++] = p;
    }
    return count;
}

/* Adds share·tint·light of some rows to colour, with light from column `first` on; share: of each material. */
KERNEL(sparse_add, "rows i64[r]  material i32[n]  share f64[M]  tint f64[n,3]  light f64[n,q]  first i64  colour f64[n,3]!"
       ";  0<=first  first+3<=q  0<=rows<n  0<=material<M")
i64 sparse_add(i64 r, i64 n, i64 M, i64 q, const i64 *rows, const i32 *material, const f64 *share, const f64 *tint,
               const f64 *light, i64 first, f64 *colour) {
    (void)n, (void)M;
    for (i64 k = 0; k < r; k++) {
        i64 p = rows[k];
        for (int j = 0; j < 3; j++) colour[3 * p + j] += share[material[p]] * tint[3 * p + j] * light[p * q + first + j];
    }
    return 0;
}
