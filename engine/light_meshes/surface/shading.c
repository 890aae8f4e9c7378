/* Ω, the light that light i brings to a receiver if nothing stands between (shading.py), for several receivers at once.

   The loops over the receivers of a block have no branch that depends on the receiver, so that compilers can
   vectorise them. Each loop is written once for all types of light. The type is a constant wherever `arriving` is
   inlined, so code that only other types need is removed. Lamps with a size have loops of their own: sized_block.h. */
#include "shading_bounds.h"
#include "shading_marks.h"
#include "shading_shares.h"
#include "shading_sums.h"

/* Fills active with the bits of the lights for which ξ_i·Ω_i ≠ 0. unlit: also sets the bits of lights that reach P
   (ξ_i·I_i·f_att ≠ 0) but from which the material reflects nothing; the shadow passes need these. */
KERNEL(shading_reaching, LIGHTS MATERIALS HITS "unlit i64  active u64[n,W]!"
       ";  T=0|T=5152  W=words(L)  0<=material<M")
i64 shading_reaching(i64 L, i64 M, i64 T, i64 n, i64 W, TAKEN, i64 unlit, u64 *active) {
    GATHERED;
    Block block, mirrors;
    materials.tables = 0;
    for (i64 first = 0; first < n; first += SIDE) {
        u64 returns = fill(&block, first, &materials, &hits, Ns + 3 * first);
        int count = n - first < SIDE ? (int)(n - first) : SIDE;
        int turned = smooth && returns & (GGX | COAT) && turned_block(&mirrors, first, count, &materials, &hits);
        Whole whole = whole_of(&block);
        enclose(&block);
        if (turned) enclose(&mirrors);
        for (i64 w = 0; w < W; w++) {
            u64 bits[SIDE] = {0}, every = 0;
            for (i64 i = 64 * w; i < L && i < 64 * w + 64; i++) {
                Source s = source_of(&lights, i);
                u64 colour = (u64)(s.colour[0] != 0.0) | (u64)(s.colour[1] != 0.0) << 1 | (u64)(s.colour[2] != 0.0) << 2;
                if (!colour) continue;
                if (!mark_whole(&s, bit(i), colour, unlit, &whole, &block, &every, bits))
                    FOR_KIND(mark, s.kind, &s, bit(i), colour, unlit != 0, &block, bits)
                if (turned) FOR_KIND(mark, s.kind, &s, bit(i), colour, unlit != 0, &mirrors, bits)
            }
            for (i64 k = 0; k < SIDE && first + k < n; k++) active[(first + k) * W + w] = bits[k] | every;
        }
    }
    return 0;
}

/* Adds U = Σ S_i·Ω_i, eqs. (2), (4) and (7), to colour, and its two terms to matt and gloss if these are given. S is
   multiplied by `shines`, where it is given, for highlights. S must be 0 where ξ_i·Ω_i is 0; this is not checked again. */
KERNEL(shading_gather,
       LIGHTS MATERIALS HITS
       "S f32[n,L,C]  shines f32[n,L,C]?  colour f64[n,3]!  matt f64[n,3]?!  gloss f64[n,3]?!"
       ";  T=0|T=5152  1<=C<=3  0<=material<M")
i64 shading_gather(i64 L, i64 M, i64 T, i64 n, i64 C, TAKEN, const f32 *S, const f32 *shines, f64 *colour, f64 *matt,
                   f64 *gloss) {
    GATHERED;
    Block block, mirrors;
    const int channel[3] = {0, (int)(C / 2), (int)(C - 1)};
    for (i64 first = 0; first < n; first += SIDE) {
        f64 share[3][SIDE], soft[3][SIDE], (*matt_share)[SIDE] = smooth || shines ? soft : share, power[SIDE];
        f32 ahead[3 * AHEAD][SIDE];
        Sums sums = {0};
        u64 some = 0;
        u64 returns = fill(&block, first, &materials, &hits, Ns + 3 * first);
        int count = n - first < SIDE ? (int)(n - first) : SIDE;
        const Block *shining = &block;  /* as facets have it, whose normals must not mirror eyes into the surface */
        if (smooth && returns & (GGX | COAT) && turned_block(&mirrors, first, count, &materials, &hits)) shining = &mirrors;
        for (int k = 0; k < count; k++) power[k] = nShiny[material[first + k]];
        for (i64 i = 0; i < L; i++) {
            Source s = source_of(&lights, i);
            if (i % AHEAD == 0) some = shares_of(S + first * L * C, count, L, i, C, ahead);
            if (!(some >> (i % AHEAD) & 1)) continue;
            for (i64 c = 0; c < C; c++)
                for (int k = 0; k < SIDE; k++) share[c][k] = ahead[i % AHEAD * C + c][k];
            if (smooth) share_of_bumps(&s, &block, shining, &hits, first, count, C, share, soft);
            else if (shines) memcpy(soft, share, sizeof soft);
            for (i64 c = 0; shines && c < C; c++)
                for (int k = 0; k < count; k++) share[c][k] *= shines[((first + k) * L + i) * C + c];
            add_all(&s, share, matt_share, channel, &block, shining, returns, count, power, &sums);
        }
        for (int k = 0; k < count; k++)
            for (int j = 0; j < 3; j++) {
                i64 at = 3 * (first + k) + j;
                f64 scattered = sums.matt[j][k] * block.matt[j][k] + sums.cloth[j][k];
                colour[at] += scattered + sums.shine[j][k] * block.gloss[j][k];
                if (matt) matt[at] += scattered;
                if (gloss) gloss[at] += sums.shine[j][k] * block.gloss[j][k];
            }
    }
    return 0;
}

/* Fills out with the largest channel of what receivers return of each active light that nothing hides; 0 of others. */
KERNEL(shading_each, LIGHTS MATERIALS HITS "active u64[n,W]  out f32[n,L]!"
       ";  T=0|T=5152  W=words(L)  0<=material<M")
i64 shading_each(i64 L, i64 M, i64 T, i64 n, i64 W, TAKEN, const u64 *active, f32 *out) {
    GATHERED;
    Block block;
    const int channel[3] = {0, 0, 0};
    memset(out, 0, (size_t)(n * L) * sizeof *out);
    for (i64 first = 0; first < n; first += SIDE) {
        f64 power[SIDE];
        u64 returns = fill(&block, first, &materials, &hits, Ns + 3 * first);
        int count = n - first < SIDE ? (int)(n - first) : SIDE;
        for (int k = 0; k < count; k++) power[k] = nShiny[material[first + k]];
        for (i64 i = 0; i < L; i++) {
            f64 share[1][SIDE] = {{0}};
            Sums sums = {0};
            u64 any = 0;
            for (int k = 0; k < count; k++) {
                u64 lit = active[(first + k) * W + (i >> 6)] & bit(i);
                share[0][k] = lit ? 1.0 : 0.0, any |= lit;
            }
            if (!any) continue;
            Source s = source_of(&lights, i);
            add_all(&s, share, share, channel, &block, &block, returns, count, power, &sums);
            for (int k = 0; k < count; k++) {
                f64 most = 0.0;
                for (int j = 0; j < 3; j++) {
                    f64 all = sums.matt[j][k] * block.matt[j][k] + sums.cloth[j][k] + sums.shine[j][k] * block.gloss[j][k];
                    most = all > most ? all : most;
                }
                out[(first + k) * L + i] = (f32)most;
            }
        }
    }
    return 0;
}

/* Adds to one (matt and gloss) what a light would give a white surface if it were visible; GGX keeps its colours. most:
   S if that is above 1, otherwise 1. */
static void add_white(const Source *s, const Block *b, int k, f64 most, f64 nShiny, f64 *one) {
    f64 brightest = most * fmax(s->colour[0], fmax(s->colour[1], s->colour[2])), gloss[3], coat[3] = {0.0}, fibres = 0.0;
    int facets = s->glossy && b->returns[k] & GGX, coated = facets && b->returns[k] & COAT;
    int sheen = s->diffuse && b->returns[k] & SHEEN;
    if (s->kind >= BALL) {
        const Sized sized = size_of(s);
        f64 P[3], N[3];
        if (facets) facets_sized(&sized, b, &b->facets, k, gloss);
        if (coated) facets_sized(&sized, b, &b->coat, k, coat);
        if (sheen) fibres = fibres_sized(&sized, b, k);
        taken(b->P, k, P), taken(b->Ns, k, N);
        if (s->diffuse) one[0] += brightest * matt_of(&sized, P, N);
        if (s->glossy && b->returns[k] & PHONG) one[1] += brightest * gloss_sized(&sized, b, k, nShiny);
    } else {
        Arriving a = arriving(s->kind, s, b, k);
        f64 power = a.power * brightest;
        if (facets) facet_power(b, &b->facets, a, k, gloss);
        if (coated) facet_power(b, &b->coat, a, k, coat);
        if (sheen) fibres = fibres_power(b, a, k);
        if (s->diffuse) one[0] += power * (a.cosine > 0.0 ? a.cosine : 0.0) * a.inverse;
        if (s->glossy && b->returns[k] & PHONG && a.lobe > 0.0 && a.cosine > 0.0)
            one[1] += power * lobe_power(a, nShiny);
    }
    if (sheen) one[1] += fibres * brightest;
    if (!facets) return;
    for (int j = 0; j < 3; j++) gloss[j] += coat[j];
    one[1] += most * fmax(gloss[0] * s->colour[0], fmax(gloss[1] * s->colour[1], gloss[2] * s->colour[2]));
}

/* Computes how much the light of a white surface may change nearby. A light that is partly visible changes by the
   share `jump`, all others by `step`. order: sorts lights so that those with equal numbers in `group` follow each
   other. Lights of a group are close together in the scene and count as one, which is partly visible if one of them
   is. Different groups are independent, so the root of the sum of their squares is used. Where S > 1 (focused
   light), the value is multiplied by S. narrow: lights that may change by all of it, as the whole group then does. */
KERNEL(shading_steps,
       LIGHTS MATERIALS HITS "S f32[n,L,C]  group i64[L]  order i64[L]  narrow u64[n,W]?  jump f64  step f64  "
       "matt f64[n]!  gloss f64[n]!"
       ";  T=0|T=5152  0<=material<M  0<=order<L")
i64 shading_steps(i64 L, i64 M, i64 T, i64 n, i64 C, i64 W, TAKEN, const f32 *S, const i64 *group, const i64 *order,
                  const u64 *narrow, f64 jump, f64 step, f64 *matt, f64 *gloss) {
    GATHERED;
    Block block;
    for (i64 first = 0; first < n; first += SIDE) {
        f64 one[SIDE][2] = {{0}}, all[SIDE][2] = {{0}};  /* of the group, and the sum of squares: matt and gloss */
        int some[SIDE] = {0};  /* 1: a light of the group is partly visible; 2 or 3: one is narrow */
        fill(&block, first, &materials, &hits, Ns + 3 * first);
        for (i64 at = 0; at < L; at++) {
            i64 i = order[at];
            Source s = source_of(&lights, i);
            int ends = at + 1 == L || group[order[at + 1]] != group[i];
            int alone = ends && (at == 0 || group[order[at - 1]] != group[i]);
            for (int k = 0; k < SIDE && first + k < n; k++) {
                f64 most = 1.0;
                for (i64 c = 0; c < C; c++) {
                    f64 share = S[((first + k) * L + i) * C + c];
                    some[k] |= share != 0.0 && share != 1.0;
                    some[k] |= narrow && has(narrow + W * (first + k), i) ? 2 : 0;
                    most = share > most ? share : most;
                }
                if (step > 0.0 || some[k] || !alone)
                    add_white(&s, &block, k, most, nShiny[material[first + k]], one[k]);
                if (!ends) continue;
                for (int j = 0; j < 2; j++) all[k][j] += square((some[k] > 1 ? 1.0 : some[k] ? jump : step) * one[k][j]), one[k][j] = 0.0;
                some[k] = 0;
            }
        }
        for (int k = 0; k < SIDE && first + k < n; k++) matt[first + k] = sqrt(all[k][0]), gloss[first + k] = sqrt(all[k][1]);
    }
    return 0;
}

/* Computes emission + Ia·ka·Od, and separately only the second term. */
KERNEL(shading_unlit,
       "ka f64[M]  emission f64[M,3]  material i32[n]  Ia f64[3]  Od f64[n,3]  colour f64[n,3]!  ambient f64[n,3]!"
       ";  0<=material<M")
i64 shading_unlit(i64 M, i64 n, const f64 *ka, const f64 *emission, const i32 *material, const f64 *Ia, const f64 *Od,
                  f64 *colour, f64 *ambient) {
    (void)M;
    for (i64 p = 0; p < n; p++) {
        i64 m = material[p];
        for (int j = 0; j < 3; j++) {
            ambient[3 * p + j] = ka[m] * Od[3 * p + j] * Ia[j];
            colour[3 * p + j] = emission[3 * m + j] + ambient[3 * p + j];
        }
    }
    return 0;
}

/* Clears the bits of lights that do not light the object owner[p]. */
KERNEL(shading_unlink, "linked u64[o,W]  owner i32[n]  active u64[n,W]!"
       ";  0<=owner<o")
i64 shading_unlink(i64 o, i64 W, i64 n, const u64 *linked, const i32 *owner, u64 *active) {
    (void)o;
    for (i64 p = 0; p < n; p++)
        for (i64 w = 0; w < W; w++) active[p * W + w] &= linked[owner[p] * W + w];
    return 0;
}

/* Computes R = d − 2(d·N)N with the shading normal, or with the geometric one if R would otherwise enter the
   surface. */
KERNEL(shading_mirrored, "way f64[n,3]  Ng f64[n,3]  Ns f64[n,3]  out f64[n,3]!")
i64 shading_mirrored(i64 n, const f64 *way, const f64 *Ng, const f64 *Ns, f64 *out) {
    for (i64 p = 0; p < n; p++) {
        const f64 *d = way + 3 * p, *g = Ng + 3 * p;
        f64 x = 0, y = 0, z = 0;
        for (int attempt = 0; attempt < 2; attempt++) {
            const f64 *N = attempt ? g : Ns + 3 * p;
            f64 twice = 2.0 * (d[0] * N[0] + d[1] * N[1] + d[2] * N[2]);
            x = d[0] - twice * N[0], y = d[1] - twice * N[1], z = d[2] - twice * N[2];
            if (x * g[0] + y * g[1] + z * g[2] > 0.0) break;
        }
        f64 length = sqrt(x * x + y * y + z * z);
        out[3 * p] = x / length, out[3 * p + 1] = y / length, out[3 * p + 2] = z / length;
    }
    return 0;
}

/* Fills out with the normals of mirrors: those that `reflecting` gives for normals Ns that nodes have bent. */
KERNEL(shading_reflecting, "way f64[n,3]  Ng f64[n,3]  Ns f64[n,3]  smooth f64[n,3]  out f64[n,3]!")
i64 shading_reflecting(i64 n, const f64 *way, const f64 *Ng, const f64 *Ns, const f64 *smooth, f64 *out) {
    for (i64 p = 0; p < n; p++) reflecting(way + 3 * p, Ng + 3 * p, Ns + 3 * p, smooth + 3 * p, out + 3 * p);
    return 0;
}
