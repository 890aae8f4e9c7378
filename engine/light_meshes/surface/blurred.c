/* Reflected rays of rough surfaces: how many, and which way (blurred.py). */
#include "layers.h"

/* From this roughness on rays count as spread out. */
#define ROUGH 0.1
/* Highlights that such rays see are not smaller than those of this roughness. */
#define LEAST_SEEN 0.2
enum { LEAST_RAYS = 4, MOST_RAYS = 32 };  /* of one camera ray at a lobe that is wide and bright */

/* One lobe at one hit: its material's row, what gets to it through a coat, and its roughness. */
typedef struct {
    f64 row[G_COLUMNS], through[3], roughness;
} Lobe;

static f64 dot3(const f64 *a, const f64 *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The coat's lobe (0) or that below it (1) of a material's row; 0 where there is none. */
static int lobe_of(const f64 *m, const f64 *tables, f64 facing, int which, Lobe *lobe) {
    if (which == 0) {
        if (m[G_COAT] <= 0.0) return 0;
        coat_row(m, lobe->row);
        to_coat(m, facing, lobe->through);
    } else {
        if (m[G_METAL] <= 0.0 && m[G_DIELECTRIC] <= 0.0) return 0;
        memcpy(lobe->row, m, sizeof lobe->row);
        to_base(m, tables, facing, facing, lobe->through);
    }
    lobe->roughness = held(lobe->row[G_ROUGHNESS], 0.0, 1.0);
    return 1;
}

/* What the lobe reflects of light from everywhere, to an eye at the cosine `facing`; returns that of the brightest
   channel. Schlick's term has the mean over facets that Fresnel's equations have for an index of 1.5, nearly. */
static f64 albedo_of(const Lobe *lobe, const f64 *tables, f64 facing, f64 *albedo) {
    f64 sight = held(facing, LEAST_SIGHT, 1.0), most = 0.0, E = bilinear(tables, G_FINE, lobe->roughness, sight);
    Gloss g = gloss_at(lobe->row, tables, facing, lobe->roughness);
    f64 metal = mean_share(tables, 1.5, lobe->roughness, sight);
    f64 plate = mean_share(tables, lobe->row[G_IOR], lobe->roughness, sight);
    for (int j = 0; j < 3; j++) {
        f64 F = g.plain[j] + g.schlick[j] * metal + g.fresnel[j] * plate;
        albedo[j] = lobe->through[j] * E * (F > 0.0 ? F : 0.0);
        most = albedo[j] > most ? albedo[j] : most;
    }
    return most;
}

/* Which share of a lobe is followed by rays. Faint reflections of rough surfaces are not, beside the light that they
   scatter (matt): rays cost much, and nobody sees them, least of all where they are mirrored themselves (again). */
static f64 followed(f64 roughness, f64 albedo, f64 matt, int again) {
    f64 rough = held((roughness - ROUGH) / 0.2, 0.0, 1.0), least = (again ? 0.4 : 0.2) * rough * (matt + albedo);
    return least > 0.0 ? held((albedo - least) / least, 0.0, 1.0) : 1.0;
}

/* How many rays of one sample follow it, of `samples` in a pixel, all of which together have `rays`: a power of 2. Narrow
   and faint lobes need fewer. */
static i32 rays_of(f64 roughness, f64 albedo, i64 samples, i64 rays) {
    f64 wanted = fmax((f64)rays / (f64)samples, LEAST_RAYS) * held(2.5 * roughness, 0.0, 1.0) * held(2.0 * albedo, 0.15, 1.0);
    i32 count = 1;
    while (count < MOST_RAYS && count < wanted) count *= 2;
    return roughness < 0.02 ? 1 : count;
}

/* Fills count with the rays that follow each hit's coat and the lobe below it, and left with what both reflect that is
   not followed, as a share of light from everywhere. fan: which rays of a pixel they are, below 0 for those that were
   not spread out yet, which may be. may: whether rays may go on from there. matt: what
   of the light the surface scatters. weight: what of the light counts. rough: how rough what is left is, a mean. */
KERNEL(blurred_count, "ggx f64[M,37]  tables f64[T]  blurred bool[M]  way f64[n,3]  Ns f64[n,3]  material i32[n]  "
       "fan i32[n]  may bool[n]  matt f64[n]  weight f64[n,3]  cutoff f64  later f64  samples i64  rays i64  count i32[n,2]!  left f64[n,3]!  "
       "rough f64[n]!"
       ";  T=5152  0<=material<M  0<samples")
i64 blurred_count(i64 M, i64 T, i64 n, const f64 *ggx, const f64 *tables, const u8 *blurred, const f64 *way, const f64 *Ns,
                  const i32 *material, const i32 *fan, const u8 *may, const f64 *matt, const f64 *weight, f64 cutoff, f64 later, i64 samples, i64 rays,
                  i32 *count, f64 *left, f64 *rough) {
    (void)M, (void)T;
    for (i64 p = 0; p < n; p++) {
        const f64 *m = ggx + G_COLUMNS * (i64)material[p], *w = weight + 3 * p;
        f64 facing = -dot3(way + 3 * p, Ns + 3 * p), brightest = fmax(w[0], fmax(w[1], w[2]));
        count[2 * p] = count[2 * p + 1] = 0;
        left[3 * p] = left[3 * p + 1] = left[3 * p + 2] = 0.0;
        rough[p] = 1.0;
        if (!blurred[material[p]]) continue;
        sheen_albedo(m, facing, left + 3 * p);
        f64 all = left[3 * p] + left[3 * p + 1] + left[3 * p + 2], sum = all;  /* sheen is as good as quite rough */
        for (int which = 0; which < 2; which++) {
            Lobe lobe;
            f64 albedo[3];
            if (!lobe_of(m, tables, facing, which, &lobe)) continue;
            f64 most = albedo_of(&lobe, tables, facing, albedo), share = followed(lobe.roughness, most, matt[p], fan[p] >= 0);
            if (!may[p] || most * share * brightest <= (fan[p] < 0 ? cutoff : later)) share = 0.0;
            if (share > 0.0) count[2 * p + which] = fan[p] < 0 ? rays_of(lobe.roughness, most, samples, rays) : 1;
            for (int j = 0; j < 3; j++) {
                f64 more = (1.0 - share) * albedo[j];
                left[3 * p + j] += more, all += more, sum += more * lobe.roughness;
            }
        }
        rough[p] = all > 0.0 ? sum / all : 1.0;
    }
    return 0;
}

/* The digits of i in a base, behind the point and in reverse. */
static f64 mirrored_digits(u32 i, u32 base) {
    f64 found = 0.0, place = 1.0 / base;
    for (; i; i /= base, place /= base) found += place * (i % base);
    return found;
}

/* Sobol's second dimension: with `mirrored_digits` of base 2 every 2^k points that follow each other are spread evenly. */
static f64 second_digits(u32 i) {
    u32 found = 0;
    for (u32 v = 1u << 31; i; i >>= 1, v ^= v >> 1)
        if (i & 1) found ^= v;
    return found * 0x1p-32;
}

/* Point i of `total` in the unit disk: the same in all pixels. depth: how many lobes the ray has met before. */
static void disk_point(u32 i, f64 total, int depth, f64 *out) {
    static const u32 primes[6] = {3, 5, 7, 11, 13, 17};
    const u32 *base = primes + 2 * (depth > 2 ? 2 : depth - 1);
    f64 x = depth ? mirrored_digits(i, base[0]) : mirrored_digits(i, 2);
    f64 y = depth ? mirrored_digits(i, base[1]) : second_digits(i);
    x += 0.5 / total, y += 0.5 / total;
    f64 r = total > 1.0 ? sqrt(x < 1.0 ? x : 1.0) : 0.0;
    out[0] = r * cos(2.0 * PI * y), out[1] = r * sin(2.0 * PI * y);
}

/* The microfacet (unit) at a point of the disk that an eye along V sees of a surface with the normal N; E. Heitz: Sampling
   the GGX distribution of visible normals, JCGT 7(4), 2018. Points lie around V as the camera's `up` says, which changes
   nowhere suddenly. */
static void facet_at(const f64 *V, const f64 *N, f64 sight, f64 alpha, const f64 *up, const f64 *point, f64 *H) {
    f64 x[3], y[3], long_ = 0.0;
    for (int c = 0; c < 3; c++) x[c] = V[c] - dot3(V, N) * N[c];
    long_ = sqrt(dot3(x, x));
    if (long_ < 1e-9) {
        f64 aside[3] = {fabs(N[0]) < 0.6, fabs(N[0]) >= 0.6, 0.0};
        for (int c = 0; c < 3; c++) x[c] = aside[c] - dot3(aside, N) * N[c];
        long_ = sqrt(dot3(x, x));
    }
    for (int c = 0; c < 3; c++) x[c] /= long_;
    y[0] = N[1] * x[2] - N[2] * x[1], y[1] = N[2] * x[0] - N[0] * x[2], y[2] = N[0] * x[1] - N[1] * x[0];
    f64 flat = sqrt(1.0 - sight * sight), e2[3];  /* e2: square to V and y */
    for (int c = 0; c < 3; c++) e2[c] = flat * N[c] - sight * x[c];
    f64 u = dot3(up, y), v = dot3(up, e2), size = sqrt(u * u + v * v);
    u = size > 1e-9 ? u / size : 1.0, v = size > 1e-9 ? v / size : 0.0;
    f64 p = point[0] * u - point[1] * v, q = point[0] * v + point[1] * u;
    f64 a = alpha * flat, stretched = sqrt(a * a + sight * sight), s = 0.5 * (1.0 + sight / stretched);
    a /= stretched;
    f64 b = sight / stretched;
    q = (1.0 - s) * sqrt(fmax(0.0, 1.0 - p * p)) + s * q;
    f64 ahead = sqrt(fmax(0.0, 1.0 - p * p - q * q));
    f64 h[3] = {alpha * (a * ahead - b * q), alpha * p, fmax(1e-12, b * ahead + a * q)}, length = sqrt(dot3(h, h));
    for (int c = 0; c < 3; c++) H[c] = (h[0] * x[c] + h[1] * y[c] + h[2] * N[c]) / length;
}

/* Where a ray goes that comes along V from a facet H of a surface with the normals N and G. Returns the cosine to N of the
   way that the facet sends it; where the triangles of a smooth mesh are in this way, it leaves as far above them. */
static f64 facet_sends(const f64 *V, const f64 *N, const f64 *G, const f64 *H, f64 c, f64 *L) {
    for (int j = 0; j < 3; j++) L[j] = 2.0 * c * H[j] - V[j];
    f64 rise = dot3(L, N), above = dot3(L, G);
    if (above <= 0.0)
        for (int j = 0; j < 3; j++) L[j] -= (2.0 * above - 1e-6) * G[j];
    f64 length = sqrt(dot3(L, L));
    for (int j = 0; j < 3; j++) L[j] /= length;
    return rise;
}

/* F of a lobe at the cosine c between facet and eye, in channel j. */
static f64 facet_reflects(const Gloss *g, int j, f64 c) {
    f64 away = 1.0 - c, fifth = square(square(away)) * away, s = fresnel_share(c, g->ior2, g->normal);
    f64 F = g->plain[j] + g->schlick[j] * fifth - g->edge[j] * (c * fifth * away) + g->fresnel[j] * s;
    return F > 0.0 ? F : 0.0;
}

/* The rays that `blurred_count` counted, in the order of hits, coats first: of which hit, which way, with what weight (0
   where microfacets send it into the surface), their number in `fan`, and how rough the lobe is, 0: not spread out.
   depth: how many lobes rays have met before. */
KERNEL(blurred_rays, "ggx f64[M,37]  tables f64[T]  way f64[n,3]  Ng f64[n,3]  Ns f64[n,3]  material i32[n]  fan i32[n]  "
       "depth i32[n]  matt f64[n]  weight f64[n,3]  up f64[3]  samples i64  count i32[n,2]  hit i64[m]!  out f64[m,3]!  "
       "share f64[m,3]!  number i32[m]!  blur f64[m]!"
       ";  T=5152  0<=material<M  0<=depth  0<samples")
i64 blurred_rays(i64 M, i64 T, i64 n, i64 most, const f64 *ggx, const f64 *tables, const f64 *way, const f64 *Ng,
                 const f64 *Ns, const i32 *material, const i32 *fan, const i32 *depth, const f64 *matt, const f64 *weight,
                 const f64 *up, i64 samples, const i32 *count, i64 *hit, f64 *out, f64 *share, i32 *number, f64 *blur) {
    (void)M, (void)T;
    i64 at = 0;
    for (i64 p = 0; p < n; p++) {
        const f64 *m = ggx + G_COLUMNS * (i64)material[p], *N = Ns + 3 * p;
        f64 V[3] = {-way[3 * p], -way[3 * p + 1], -way[3 * p + 2]}, facing = dot3(V, N);
        int fresh = fan[p] < 0;
        for (int which = 0; which < 2; which++) {
            i32 rays = count[2 * p + which];
            Lobe lobe;
            f64 albedo[3];
            if (rays < 1 || at + rays > most || !lobe_of(m, tables, facing, which, &lobe)) continue;
            f64 part = followed(lobe.roughness, albedo_of(&lobe, tables, facing, albedo), matt[p], !fresh);
            Gloss g = gloss_at(lobe.row, tables, facing, lobe.roughness);
            f64 alpha = square(lobe.roughness), aa = square(alpha);
            f64 own = sqrt(1.0 + aa * (1.0 / square(g.sight) - 1.0));
            int spread = lobe.roughness >= ROUGH;
            for (i32 k = 0; k < rays; k++, at++) {
                f64 H[3], point[2];
                i32 i = fresh ? (-1 - fan[p]) * rays + k : fan[p];
                disk_point((u32)i, fresh ? (f64)samples * rays : 4096.0, fresh ? 0 : depth[p], point);
                facet_at(V, N, g.sight, alpha, up, point, H);
                f64 c = held(dot3(V, H), 0.0, 1.0), rise = facet_sends(V, N, Ng + 3 * p, H, c, out + 3 * at);
                f64 seen = rise > 0.0 ? (1.0 + own) / (own + sqrt(1.0 + aa * (1.0 / square(rise) - 1.0))) : 0.0;  /* G2/G1 */
                for (int j = 0; j < 3; j++)
                    share[3 * at + j] = weight[3 * p + j] * part / rays * lobe.through[j] * seen * facet_reflects(&g, j, c);
                hit[at] = p, number[at] = spread || !fresh ? i : fan[p];
                blur[at] = spread ? fmax(lobe.roughness, LEAST_SEEN) : 0.0;
            }
        }
    }
    return at == most ? 0 : -1;
}

/* How many rays go on through each rough surface of glass, and come back from it. */
KERNEL(blurred_glass_count, "roughness f64[n]  fan i32[n]  samples i64  rays i64  count i32[n]!"
       ";  0<samples")
i64 blurred_glass_count(i64 n, const f64 *roughness, const i32 *fan, i64 samples, i64 rays, i32 *count) {
    for (i64 p = 0; p < n; p++) count[p] = fan[p] < 0 ? rays_of(held(roughness[p], 0.0, 1.0), 1.0, samples, rays) : 1;
    return 0;
}

/* The microfacets that these rays meet, in the order of hits; hit, number and blur are as in `blurred_rays`. */
KERNEL(blurred_glass, "way f64[n,3]  Ns f64[n,3]  roughness f64[n]  fan i32[n]  depth i32[n]  up f64[3]  samples i64  "
       "count i32[n]  hit i64[m]!  facet f64[m,3]!  number i32[m]!  blur f64[m]!"
       ";  0<=depth  0<samples")
i64 blurred_glass(i64 n, i64 most, const f64 *way, const f64 *Ns, const f64 *roughness, const i32 *fan, const i32 *depth,
                  const f64 *up, i64 samples, const i32 *count, i64 *hit, f64 *facet, i32 *number, f64 *blur) {
    i64 at = 0;
    for (i64 p = 0; p < n; p++) {
        const f64 *N = Ns + 3 * p;
        f64 V[3] = {-way[3 * p], -way[3 * p + 1], -way[3 * p + 2]}, rough = held(roughness[p], 0.0, 1.0);
        int fresh = fan[p] < 0, spread = rough >= ROUGH;
        for (i32 k = 0; k < count[p] && at < most; k++, at++) {
            f64 point[2];
            i32 i = fresh ? (-1 - fan[p]) * count[p] + k : fan[p];
            disk_point((u32)i, fresh ? (f64)samples * count[p] : 4096.0, fresh ? 0 : depth[p], point);
            facet_at(V, N, held(dot3(V, N), LEAST_SIGHT, 1.0), square(rough), up, point, facet + 3 * at);
            hit[at] = p, number[at] = spread || !fresh ? i : fan[p], blur[at] = spread ? fmax(rough, LEAST_SEEN) : 0.0;
        }
    }
    return at == most ? 0 : -1;
}
