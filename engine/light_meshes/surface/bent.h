/* Light on surfaces whose normal nodes have bent, as Cycles' bump map correction has it.

   A. Conty Estevez, P. Lecocq, C. Stein: A microfacet-based shadowing function to solve the bump terminator problem, Ray
   Tracing Gems, 2019. Bumps stand for a rough surface whose facets are as steep as the normal is bent: what these would
   mask is taken from what is scattered. Nothing is reflected of light from behind the smooth surface.

   M. J.-Y. Chiang, Y. K. Li, B. Burley: Taming the shadow terminator, SIGGRAPH 2019 Talks. Releases of Cycles before 4.5 soften
   by this older formula, which only knows how much lower light stands over the smooth surface than over the bent one. */
#pragma once
#include "highlights.h"

/* Whether a surface with these two normals returns nothing of the light from this way, since it comes from behind the smooth
   one. */
static int from_behind(const f64 *smooth, const f64 *bent, const Way *way) {
    const f64 L[3] = {way->x, way->y, way->z};
    return dot3(smooth, L) * dot3(smooth, bent) * dot3(bent, L) < 0.0;
}

/* What the older formula leaves where light stands this many times as high over the smooth surface as over the bent one. */
static inline f64 left_by_angle(f64 g) { return g >= 1.0 ? 1.0 : g > 0.0 ? g * (1.0 + g * (1.0 - g)) : 0.0; }

/* What is left of light from this way, for what is scattered; facets: as facets would leave it, else by the older formula. */
static f64 left_by_bumps(const f64 *smooth, const f64 *bent, const Way *way, int facets) {
    f64 light = (smooth[0] * way->x + smooth[1] * way->y + smooth[2] * way->z) * way->inverse, turned = dot3(smooth, bent);
    f64 cc = light * light, tt = turned * turned;
    if (smooth[0] == bent[0] && smooth[1] == bent[1] && smooth[2] == bent[2]) return 1.0;
    if (from_behind(smooth, bent, way)) return 0.0;
    if (!facets) {
        f64 over = (bent[0] * way->x + bent[1] * way->y + bent[2] * way->z) * way->inverse * turned;
        return over != 0.0 ? left_by_angle(light / over) : 0.0;
    }
    if (tt >= 1.0 || cc >= 1.0) return 1.0;
    f64 slope = 0.125 * (1.0 / (tt > 1e-12 ? tt : 1e-12) - 1.0), alpha2 = slope < 1.0 ? slope : 1.0;
    return cc < 1e-12 ? 0.0 : 2.0 / (1.0 + sqrt(1.0 + alpha2 * (1.0 / cc - 1.0)));
}

/* Multiplies share by what is left of a lamp's light at each receiver of a block where it is mirrored; soft is filled with
   what is left where it is scattered; both have C channels. mirrors: the block as mirrors have it. Of a lamp with a size
   its middle counts. */
static void share_of_bumps(const Source *s, const Block *b, const Block *mirrors, const Receivers *hits, i64 first, int count,
                           i64 C, f64 (*share)[SIDE], f64 (*soft)[SIDE]) {
    memcpy(soft, share, (size_t)C * sizeof *share);
    const Source from = s->kind >= BALL ? middle_of(s) : *s;
    for (int k = 0; k < count; k++) {
        const f64 *smooth = hits->smooth + 3 * (first + k);
        f64 N[3], M[3];
        taken(b->Ns, k, N), taken(mirrors->Ns, k, M);
        Way way = way_to_light(from.kind, &from, b->P[0][k], b->P[1][k], b->P[2][k]);
        f64 scattered = left_by_bumps(smooth, N, &way, b->facet_bumps[k] != 0.0), mirrored = from_behind(smooth, M, &way) ? 0.0 : 1.0;
        for (i64 j = 0; j < C; j++) soft[j][k] *= scattered, share[j][k] *= mirrored;
    }
}

/* The normal nearest to N, in its plane with Ng, that mirrors an eye's ray along `way` out of the surface, by a little; N
   itself if that does, or if nodes did not bend it. With I to the eye, z along Ng and x square to it in that plane, what is
   mirrored has the height 2·N·I·N_z - I_z, which is to be t: a square equation for N_z². */
static int reflecting(const f64 *way, const f64 *Ng, const f64 *N, const f64 *smooth, f64 *out) {
    memcpy(out, N, 3 * sizeof *out);
    if (N[0] == smooth[0] && N[1] == smooth[1] && N[2] == smooth[2]) return 0;
    f64 up = -dot3(way, Ng), Iz = up > 0.0 ? up : 0.0, t = 0.9 * Iz < 0.01 ? 0.9 * Iz : 0.01, along = dot3(N, Ng), x[3];
    if (-2.0 * dot3(N, way) * along - up >= t) return 0;
    for (int j = 0; j < 3; j++) x[j] = N[j] - along * Ng[j];
    f64 length = sqrt(dot3(x, x));
    if (length < 1e-9) return 0;
    f64 Ix = -dot3(way, x) / length, a = Ix * Ix + Iz * Iz, b = 2.0 * (a + Iz * t), c = square(t + Iz);
    if (a < 1e-30) return 0;
    f64 root = sqrt(b * b > 4.0 * a * c ? b * b - 4.0 * a * c : 0.0), zz = 0.25 * (Ix < 0.0 ? b + root : b - root) / a;
    zz = zz < 0.0 ? 0.0 : zz < 1.0 ? zz : 1.0;
    f64 Nz = sqrt(zz), Nx = sqrt(1.0 - zz) / length;
    for (int j = 0; j < 3; j++) out[j] = Nx * x[j] + Nz * Ng[j];
    return 1;
}

/* Loads the receivers from `first` on with the normals of `reflecting`, if any differs; returns whether. */
static int turned_block(Block *b, i64 first, int count, const Materials *materials, const Receivers *hits) {
    f64 turned[SIDE][3];
    int any = 0;
    for (int k = 0; k < count; k++) {
        i64 at = 3 * (first + k);
        any |= reflecting(hits->direction + at, hits->Ng + at, hits->Ns + at, hits->smooth + at, turned[k]);
    }
    if (any) fill(b, first, materials, hits, turned[0]);
    return any;
}
