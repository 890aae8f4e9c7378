/* Tables of what GGX reflects in all, and how it dims what is below (ggx.h). */
#include "layers.h"

enum { RADII = 24, ANGLES = 20, FACETS = RADII * ANGLES };  /* of the quadrature over microfacets that an eye sees */

/* Of an eye at the cosine mu: E, and for each of n indices of refraction the mean of s. The microfacets are taken as
   E. Heitz has them (Sampling the GGX distribution of visible normals, JCGT 7(4), 2018), on a grid instead of at random;
   one half of them, as the other is the same. */
static f64 over_facets(f64 roughness, f64 mu, const f64 (*disk)[3], const f64 *ior2, const f64 *normal, int n, f64 *share) {
    f64 alpha = square(roughness), x = alpha * sqrt(1.0 - mu * mu), long_ = sqrt(x * x + mu * mu), E = 0.0;
    f64 a = x / long_, b = mu / long_, s = 0.5 * (1.0 + b), aa = alpha * alpha, V[3] = {sqrt(1.0 - mu * mu), 0.0, mu};
    f64 own = sqrt(1.0 + aa * (1.0 / (mu * mu) - 1.0));
    for (int i = 0; i < n; i++) share[i] = 0.0;
    for (int i = 0; i < FACETS; i++) {
        f64 p = disk[i][0], q = (1.0 - s) * sqrt(1.0 - p * p) + s * disk[i][1], up = sqrt(fmax(0.0, 1.0 - p * p - q * q));
        f64 H[3] = {alpha * (a * up - b * q), alpha * p, fmax(1e-12, b * up + a * q)};
        f64 size = sqrt(H[0] * H[0] + H[1] * H[1] + H[2] * H[2]), c = (V[0] * H[0] + V[2] * H[2]) / size;
        f64 out = 2.0 * c * H[2] / size - V[2];
        if (out <= 0.0 || c <= 0.0) continue;  /* into the surface */
        E += disk[i][2] * (1.0 + own) / (own + sqrt(1.0 + aa * (1.0 / (out * out) - 1.0)));
        for (int j = 0; j < n; j++) share[j] += disk[i][2] * fresnel_share(c < 1.0 ? c : 1.0, ior2[j], normal[j]);
    }
    return E;
}

/* Fills the tables of ggx.h. */
KERNEL(ggx_tables, "tables f64[T]!"
       ";  T=5152")
i64 ggx_tables(i64 T, f64 *tables) {
    if (T != G_TABLES) return -1;
    f64 ior2[G_COARSE], normal[G_COARSE], share[G_COARSE], disk[FACETS][3], sum = 0.0;
    for (int i = 0; i < FACETS; i++) {
        /* Closer together at the disk's edge, where the distribution has its long tail. */
        f64 t = 1.0 - (i / ANGLES + 0.5) / RADII, r = sqrt(1.0 - t * t * t), turn = PI * ((i % ANGLES + 0.5) / ANGLES - 0.5);
        disk[i][0] = r * cos(turn), disk[i][1] = r * sin(turn), disk[i][2] = 3.0 * t * t / FACETS;
        sum += disk[i][2];
    }
    for (int z = 0; z < G_COARSE; z++) {
        f64 root = square(held((f64)z / (G_COARSE - 1), 1e-4, 0.99));
        ior2[z] = square((1.0 + root) / (1.0 - root)), normal[z] = square(root);
    }
    for (int i = 0; i < FACETS; i++) disk[i][2] /= sum;
    for (int r = 0; r < G_FINE; r++) {
        f64 roughness = fmax((f64)r / (G_FINE - 1), 1e-4), *row = tables + r * G_FINE, mean = 0.0;
        for (int c = 0; c < G_FINE; c++)
            row[c] = over_facets(roughness, held((f64)c / (G_FINE - 1), 1e-4, 1.0), disk, ior2, normal, 0, share);
        /* The integral of 2·µ·E(µ), E being linear between entries. */
        for (int c = 0; c + 1 < G_FINE; c++) {
            f64 step = 1.0 / (G_FINE - 1), from = c * step;
            mean += step * (from * (row[c] + row[c + 1]) + step * (row[c] + 2.0 * row[c + 1]) / 3.0);
        }
        tables[G_MEAN + r] = mean;
    }
    for (int r = 0; r < G_COARSE; r++)
        for (int c = 0; c < G_COARSE; c++) {
            over_facets(fmax((f64)r / (G_COARSE - 1), 1e-4), held((f64)c / (G_COARSE - 1), 1e-4, 1.0), disk,
                        ior2, normal, G_COARSE, share);
            for (int z = 0; z < G_COARSE; z++) tables[G_SHARE + (z * G_COARSE + r) * G_COARSE + c] = share[z];
        }
    return 0;
}

/* Multiplies the colours Od of what lies below a dielectric by what gets past it, seen along `way`. above: the normals of
   coats, where these are others than Ns. */
KERNEL(ggx_dim, "ggx f64[M,37]  tables f64[T]  way f64[n,3]  Ns f64[n,3]  above f64[n,3]?  material i32[n]  Od f64[n,3]!"
       ";  T=5152  0<=material<M")
i64 ggx_dim(i64 M, i64 T, i64 n, const f64 *ggx, const f64 *tables, const f64 *way, const f64 *Ns, const f64 *above,
            const i32 *material, f64 *Od) {
    (void)M, (void)T;
    for (i64 p = 0; p < n; p++) {
        const f64 *m = ggx + G_COLUMNS * (i64)material[p], *d = way + 3 * p, *N = Ns + 3 * p, *C = above ? above + 3 * p : N;
        if (m[G_ON] == 0.0) continue;
        f64 facing = -(d[0] * N[0] + d[1] * N[1] + d[2] * N[2]), left = below(m, tables, facing), through[3];
        to_base(m, tables, facing, -(d[0] * C[0] + d[1] * C[1] + d[2] * C[2]), through);
        for (int j = 0; j < 3; j++) Od[3 * p + j] *= left * through[j];
    }
    return 0;
}
