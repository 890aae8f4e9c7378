/* Ω of hundreds of lamps, of which those that are far away count together as one (clusters.py). */
#include <stdlib.h>

#include "clusters.h"
#include "shading_marks.h"

/* What receivers of a block get of a node: a lamp, or several that count as one. */
typedef struct {
    u32 lanes; /* which receivers take it as one; 0 where all go on to its halves */
    f32 all[SIDE], wrong[SIDE], matt[3][SIDE], gloss[3][SIDE]; /* all: of the brightest channel, of both halves together where they are taken */
} Piece;

/* A block at work. */
typedef struct {
    const Clusters *tree;
    const Lights *lights;
    const Receivers *hits;
    Block block, mirrors;
    const Block *shining;
    const f64 (*side)[SIDE], (*smooth)[SIDE];
    i64 first, found, room;
    int count;
    u64 returns;
    f64 power[SIDE]; /* Phong's exponents */
    i64 *node;       /* of each piece, those nearer to the root first */
    i32 *piece;      /* of each node; it counts only if that piece is of the node */
    Piece *pieces;
} Work;

/* The lamp that stands for all of a node, or the lamp of a leaf. */
static Source source_at(const Work *w, i64 node, i64 lamp) {
    const Clusters *t = w->tree;
    Source s = source_of(w->lights, lamp);
    if (node >= t->leaves) return s;
    const f64 *at = t->middle + 3 * node;
    s.kind = POINT, s.x = at[0], s.y = at[1], s.z = at[2];
    for (int j = 0; j < 3; j++) s.colour[j] = t->power[3 * node + j];
    return s;
}

/* The first lamp below a node that has any. */
static i64 some_lamp(const Clusters *t, i64 node) {
    while (node < t->leaves) node = t->state[2 * node] == EMPTY ? 2 * node + 1 : 2 * node;
    return t->order[node - t->leaves];
}

/* The receivers of mask that a single lamp reaches, as `shading_reaching` has them. */
static u32 reached(const Work *w, const Source *s, const Block *facing, const Block *turned, u32 mask) {
    u64 bits[SIDE] = {0};
    u32 out = 0;
    u64 colour = (u64)(s->colour[0] != 0.0) | (u64)(s->colour[1] != 0.0) << 1 | (u64)(s->colour[2] != 0.0) << 2;
    if (!colour) return 0;
    FOR_KIND(mark, s->kind, s, 1, colour, 0, facing, bits)
    if (turned) FOR_KIND(mark, s->kind, s, 1, colour, 0, turned, bits)
    for (int k = 0; k < w->count; k++) out |= (u32)(bits[k] & 1) << k;
    return out & mask;
}

/* Adds to a piece what the receivers of mask get of a lamp. */
static void light_by(const Work *w, const Source *s, u32 mask, Piece *p) {
    const int channel[3] = {0, 0, 0};
    f64 share[1][SIDE], soft[1][SIDE];
    Sums sums;
    memset(&sums, 0, sizeof sums);
    for (int k = 0; k < SIDE; k++) share[0][k] = mask >> k & 1 ? 1.0 : 0.0;
    memcpy(soft, share, sizeof soft);
    if (w->hits->smooth) share_of_bumps(s, &w->block, w->shining, w->hits, w->first, w->count, 1, share, soft);
    add_all(s, share, soft, channel, &w->block, w->shining, w->returns, w->count, w->power, &sums);
    for (int k = 0; k < SIDE; k++) {
        f64 most = 0.0;
        if (!(mask >> k & 1)) continue;
        for (int j = 0; j < 3; j++) {
            f64 matt = sums.matt[j][k] * w->block.matt[j][k] + sums.cloth[j][k], gloss = sums.shine[j][k] * w->block.gloss[j][k];
            p->matt[j][k] = (f32)matt, p->gloss[j][k] = (f32)gloss;
            most = matt + gloss > most ? matt + gloss : most;
        }
        p->all[k] = (f32)most;
    }
}

/* Finds the pieces of all receivers of a block: each goes down the tree until a node may be one lamp, wrong by at most
   allowed; with coarse, until lamps are within an angle. Returns 0 without memory. */
static int descend(Work *w, const Block *facing, const Block *turned, const f64 *allowed, int coarse, i64 *nodes, u32 *masks) {
    const Clusters *t = w->tree;
    i64 depth = 0;
    w->found = 0, nodes[0] = 1, masks[0] = w->count == 32 ? ~(u32)0 : ((u32)1 << w->count) - 1, depth = 1;
    while (depth) {
        i64 node = nodes[--depth];
        u32 mask = masks[depth], dark = 0, taken_by = 0;
        if (t->state[node] == EMPTY) continue;
        if (w->found == w->room) {
            i64 room = 2 * w->room;
            Piece *more = realloc(w->pieces, (size_t)room * sizeof *more);
            if (more) w->pieces = more;
            i64 *of = more ? realloc(w->node, (size_t)room * sizeof *of) : 0;
            if (!of) return 0;
            w->node = of, w->room = room;
        }
        Piece *p = w->pieces + w->found;
        Source s = source_at(w, node, some_lamp(t, node));
        memset(p, 0, sizeof *p);
        w->node[w->found] = node, w->piece[node] = (i32)w->found++;
        if (node >= t->leaves) {
            taken_by = reached(w, &s, facing, turned, mask), dark = mask & ~taken_by;
        } else if (t->state[node] == ONE) {
            if (coarse) taken_by = is_small(t, node, &w->block, mask);
            else taken_by = may_be_one(t, node, &s, &w->block, w->shining, w->side, w->smooth, w->returns, allowed, mask, &dark, p->wrong);
        }
        if (taken_by) light_by(w, &s, taken_by, p);
        p->lanes = taken_by, mask &= ~(taken_by | dark);
        if (!mask) continue;
        nodes[depth] = 2 * node + 1, masks[depth++] = mask, nodes[depth] = 2 * node, masks[depth++] = mask;
    }
    for (i64 i = w->found - 1; i >= 0; i--) { /* halves come behind what they are halves of */
        i64 node = w->node[i];
        Piece *p = w->pieces + i;
        if (node >= t->leaves) continue;
        for (int half = 0; half < 2; half++) {
            i64 below = w->piece[2 * node + half];
            if (below <= i || below >= w->found || w->node[below] != 2 * node + half) continue;
            const Piece *of = w->pieces + below;
            for (int k = 0; k < SIDE; k++)
                if (!(p->lanes >> k & 1)) p->all[k] += of->all[k], p->wrong[k] += of->wrong[k];
        }
    }
    return 1;
}

/* The groups of one receiver, as they are found. */
typedef struct {
    i64 found, room;
    i32 *lamp;
    f32 *light; /* of each six numbers: what is scattered, what is mirrored */
} Groups;

static const Piece *piece_of(const Work *w, i64 node) {
    i64 i = w->piece[node];
    return i >= 0 && i < w->found && w->node[i] == node ? w->pieces + i : 0;
}

/* Adds up the light of a group's pieces. */
static void light_of_group(const Work *w, i64 node, int k, i64 *stack, f32 *light) {
    i64 depth = 0;
    for (stack[depth++] = node; depth;) {
        i64 at = stack[--depth];
        const Piece *p = piece_of(w, at);
        if (!p || !(p->all[k] > 0.0f)) continue;
        if (p->lanes >> k & 1) {
            for (int j = 0; j < 3; j++) light[j] += p->matt[j][k], light[3 + j] += p->gloss[j][k];
        } else {
            stack[depth++] = 2 * at + 1, stack[depth++] = 2 * at;
        }
    }
}

/* Lets one lamp below a node stand for all; each is as likely as it gives light, by the number u in [0,1). */
static i64 chosen(const Work *w, i64 node, int k, f64 u) {
    const Clusters *t = w->tree;
    f64 left = u;
    int one = 0; /* below a node that counts as one, where other receivers may have gone on */
    while (node < t->leaves) {
        const Piece *p = piece_of(w, node);
        f64 a, b;
        one |= !p || p->lanes >> k & 1;
        if (!one) {
            const Piece *x = piece_of(w, 2 * node), *y = piece_of(w, 2 * node + 1);
            a = x ? x->all[k] : 0.0, b = y ? y->all[k] : 0.0;
        } else {
            const f64 *x = t->power + 6 * node;
            a = x[0] + x[1] + x[2], b = x[3] + x[4] + x[5];
        }
        f64 share = a / (a + b);
        node *= 2;
        if (b > 0.0 && (left >= share || !(a > 0.0))) left = share < 1.0 ? (left - share) / (1.0 - share) : 0.0, node++;
        else left = left / share;
        left = left < 0.0 ? 0.0 : left < 1.0 ? left : 0.0;
    }
    return t->order[node - t->leaves];
}

/* SplitMix64's finaliser. */
static u64 mixed(u64 x) {
    x = (x ^ x >> 30) * MIX;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

/* Puts receiver k's groups, the largest nodes that give it at most `most`, into g, as far as there is room. Returns what
   lamps give for whose shadows others stand. */
static f64 group(const Work *w, int k, f64 most, i64 *stack, i64 *second, Groups *g, u64 *asked, u64 *several, f32 *weight) {
    u64 key = SPREAD, bits;
    f64 bound = 0.0;
    i64 depth = 0;
    for (int j = 0; j < 3; j++) memcpy(&bits, &w->block.P[j][k], sizeof bits), key = mixed(key ^ bits);
    if (!w->found) return 0.0;
    const f64 all = w->pieces[0].all[k];
    for (stack[depth++] = 1; depth;) {
        i64 node = stack[--depth];
        const Piece *p = piece_of(w, node);
        if (!p || !(p->all[k] > 0.0f)) continue;
        int one = p->lanes >> k & 1;
        if (!one && !(w->tree->together[node] && p->all[k] <= most)) {
            stack[depth++] = 2 * node + 1, stack[depth++] = 2 * node;
            continue;
        }
        i64 lamp = chosen(w, node, k, (f64)(mixed(key + (u64)node) >> 11) * 0x1p-53);
        set_bit(asked, lamp), weight[lamp] = p->all[k];
        if (node < w->tree->leaves) set_bit(several, lamp), bound += p->all[k];
        if (g->found < g->room) {
            f32 *light = g->light + 6 * g->found;
            memset(light, 0, 6 * sizeof *light);
            light_of_group(w, node, k, second, light);
            g->lamp[g->found] = (i32)lamp;
        }
        g->found++;
    }
    return bound < all ? bound : all;
}

/* Loads a block, and its copies with other normals. returns: what facets count with if not `materials`. */
static void load(Work *w, i64 first, const Materials *m, const Materials *shown, const Receivers *hits, const f64 *faces,
                 Block *facing, const Block **turned, f64 (*side)[SIDE], f64 (*smooth)[SIDE]) {
    w->first = first, w->count = hits->n - first < SIDE ? (int)(hits->n - first) : SIDE;
    w->returns = fill(&w->block, first, m, hits, hits->Ns + 3 * first), w->shining = &w->block, *turned = 0;
    int bent = hits->smooth && w->returns & (GGX | COAT) && turned_block(&w->mirrors, first, w->count, shown, hits);
    if (!bent && shown != m) fill(&w->mirrors, first, shown, hits, hits->Ns + 3 * first);
    if (bent || shown != m) w->shining = &w->mirrors;
    *facing = w->block;
    for (int k = 0; k < SIDE; k++) {
        i64 p = first + (k < w->count ? k : w->count - 1);
        w->power[k] = m->nShiny[hits->material[p]];
        for (int j = 0; j < 3; j++) {
            side[j][k] = facing->Ng[j][k] = faces[3 * p + j];
            if (hits->smooth) smooth[j][k] = hits->smooth[3 * p + j];
        }
    }
    if (bent) memcpy(w->mirrors.Ng, side, sizeof w->mirrors.Ng), *turned = &w->mirrors;
    enclose(facing), enclose(&w->mirrors);
    w->side = side, w->smooth = hits->smooth ? smooth : 0;
}

/* For each receiver the lamps whose shadow is asked for, and what it gets of those for which each stands. faces: the
   normals that say which lamps are above; shown: materials by which highlights count, NULL: the same. start (n+1): where
   each receiver's groups begin; lamp, light (g): of groups; asked, several, weight, bound: as `lamp_groups` has them;
   total (n,): all light; wrong (n,): by how much that may be wrong. Returns the number of groups: more than there is room, if they do not fit. −1: no memory. */
KERNEL(clusters_asked,
       LIGHTS MATERIALS HITS "faces f64[n,3]  shown f64[M,32]?  order i32[l]  together bool[m]  state u8[m]  middle f64[m,3]  "
       "reach f64[m]  size f64[m]  amount f64[m,3]  moment f64[m,3]  second f64[m,3]  threshold f64[n]  part f64  start i64[k]!  lamp i32[g]!  "
       "light f32[g,6]!  asked u64[n,W]!  several u64[n,W]!  weight f32[n,L]!  bound f64[n]!  total f64[n]!  wrong f64[n]!")
i64 clusters_asked(i64 L, i64 M, i64 T, i64 n, i64 l, i64 m, i64 k, i64 g, i64 W, TAKEN, const f64 *faces, const f64 *shown,
                   const i32 *order, const u8 *together, const u8 *state, const f64 *middle, const f64 *reach, const f64 *size,
                   const f64 *amount, const f64 *moment, const f64 *second, const f64 *threshold, f64 part, i64 *start, i32 *lamp,
                   f32 *light, u64 *asked, u64 *several, f32 *weight, f64 *bound, f64 *total, f64 *wrong) {
    GATHERED;
    Materials others = {kd, ks, Os, nShiny, shown ? shown : ggx, tables};
    Clusters tree = {l, order, together, state, middle, reach, size, amount, moment, second};
    Groups groups = {0, g, lamp, light};
    Work w = {.tree = &tree, .lights = &lights, .hits = &hits, .room = 512};
    i64 depth = 128;
    i64 *stack = malloc((size_t)depth * 2 * sizeof *stack);
    u32 *masks = malloc((size_t)depth * sizeof *masks);
    w.pieces = malloc((size_t)w.room * sizeof *w.pieces), w.node = malloc((size_t)w.room * sizeof *w.node);
    w.piece = malloc((size_t)m * sizeof *w.piece);
    int fine = stack && masks && w.pieces && w.node && w.piece && k == n + 1 && m == 2 * l;
    for (i64 i = 0; fine && i < m; i++) w.piece[i] = -1;
    for (i64 from = 0; fine && from < n; from += SIDE) {
        Block facing;
        const Block *turned;
        f64 side[3][SIDE], smoothed[3][SIDE], allowed[SIDE] = {0};
        load(&w, from, &materials, shown ? &others : &materials, &hits, faces, &facing, &turned, side, smoothed);
        fine = descend(&w, &facing, turned, allowed, 1, stack, masks);
        for (int i = 0; fine && i < w.count; i++) allowed[i] = w.found ? threshold[from + i] * part * w.pieces[0].all[i] : 0.0;
        fine = fine && descend(&w, &facing, turned, allowed, 0, stack, masks);
        for (int i = 0; fine && i < w.count; i++) {
            i64 p = from + i;
            start[p] = groups.found, total[p] = w.found ? w.pieces[0].all[i] : 0.0;
            wrong[p] = w.found ? w.pieces[0].wrong[i] : 0.0;
            bound[p] = group(&w, i, threshold[p] * total[p], stack, stack + depth, &groups, asked + p * W, several + p * W, weight + p * L);
        }
    }
    if (k == n + 1) start[n] = groups.found;
    free(stack), free(masks), free(w.pieces), free(w.node), free(w.piece);
    return fine ? groups.found : -1;
}

/* Adds what groups return that S leaves of their lamps' light to colour, and its two terms to matt and gloss. */
KERNEL(clusters_sum, "start i64[k]  lamp i32[g]  light f32[g,6]  S f32[n,L,C]  colour f64[n,3]!  matt f64[n,3]?!  gloss f64[n,3]?!")
i64 clusters_sum(i64 k, i64 g, i64 n, i64 L, i64 C, const i64 *start, const i32 *lamp, const f32 *light, const f32 *S,
                 f64 *colour, f64 *matt, f64 *gloss) {
    const i64 channel[3] = {0, C / 2, C - 1};
    if (k != n + 1) return 1;
    for (i64 p = 0; p < n; p++)
        for (i64 i = start[p]; i < start[p + 1] && i < g; i++)
            for (int j = 0; j < 3; j++) {
                f64 share = S[(p * L + lamp[i]) * C + channel[j]], a = share * light[6 * i + j], b = share * light[6 * i + 3 + j];
                colour[3 * p + j] += a + b;
                if (matt) matt[3 * p + j] += a;
                if (gloss) gloss[3 * p + j] += b;
            }
    return 0;
}
