/* What happens at a surface that lets light through (interfaces.py). */
#include "../surface/texels.h"
#include "../rays/triangles.h"
#include "fresnel.h"
#include "straight.h"

/* Returns the body with the highest rank, −1 if there is none. */
static i32 top(i64 count, const i32 *media, const i64 *rank) {
    i32 best = -1;
    for (i64 j = 0; j < count; j++)
        if (media[j] >= 0 && (best < 0 || rank[media[j]] > rank[best])) best = media[j];
    return best;
}

static void enter(i64 count, i32 *media, i32 m) {
    for (i64 j = 0; j < count; j++)
        if (media[j] < 0) {
            media[j] = m;
            return;
        }
}

static void leave(i64 count, i32 *media, i32 m) {
    for (i64 j = 0; j < count; j++) {
        if (media[j] != m) continue;
        for (; j < count - 1; j++) media[j] = media[j + 1];
        media[count - 1] = -1;
    }
}

/* Computes the unit direction behind a surface with the normals N and G from the direction d, by Snell's law. */
static void refract(const f64 *d, const f64 *N, const f64 *G, f64 eta, f64 cosine, f64 square_of, f64 *out) {
    f64 f = eta * cosine - sqrt(square_of);
    for (int c = 0; c < 3; c++) out[c] = eta * d[c] + f * N[c];
    f64 into = dot(out, G);
    if (into >= 0.0)  /* interpolated shading normals must not send it back out */
        for (int c = 0; c < 3; c++) out[c] -= (into + 1e-6) * G[c];
    f64 length = sqrt(dot(out, out));
    for (int c = 0; c < 3; c++) out[c] /= length;
}

/* Computes what happens to rays at surfaces that let light through. media: the bodies in which each ray is; changed to
   those behind the surface. The other outputs are those of Face.

   A ray that entered a round body can always leave it. But facets have errors: a grazing ray may meet a facet whose
   normal points away, and be totally reflected at another. Both are treated as grazing (`grazing`: see facets in
   bodies.py); otherwise single pixels would show another part of the scene. */
KERNEL(interfaces_cross,
       "Ng f64[n,3]  Ns f64[n,3]  material i32[n]  triangle i32[n]  front bool[n]  way f64[n,3]  bodies i32[t]  "
       "index f64[b]  rank i64[b]  grazing f64[t]  ior f64[M]  by_fresnel bool[M]  kt f64[M,3]  mirror f64[M,3]  share f64[M]  real bool[n]!  bends bool[n]!  "
       "passed f64[n,3]!  mirrored f64[n,3]!  refracted f64[n,3]!  media i32[n,d]!"
       ";  0<=material<M  0<=triangle<t  -1<=media<b;  -1<=bodies<b")
i64 interfaces_cross(i64 n, i64 t, i64 b, i64 M, i64 depth, const f64 *Ng, const f64 *Ns, const i32 *material,
                     const i32 *triangle, const u8 *front, const f64 *way, const i32 *bodies,
                     const f64 *index, const i64 *rank, const f64 *grazing, const f64 *ior, const u8 *by_fresnel, const f64 *kt, const f64 *mirror, const f64 *share, u8 *real, u8 *bends,
                     f64 *passed, f64 *mirrored, f64 *refracted, i32 *media) {
    (void)t, (void)b, (void)M;
    for (i64 k = 0; k < n; k++) {
        i32 m = material[k], *own = media + depth * k;
        const f64 *d = way + 3 * k, *N = Ns + 3 * k, *G = Ng + 3 * k, *through = kt + 3 * (i64)m;
        f64 n1 = 1.0, n2 = 1.0, reflected = 0.0, *pass = passed + 3 * k, *back = mirrored + 3 * k, *on = refracted + 3 * k;
        real[k] = 1, bends[k] = 0;
        i32 body = bodies[triangle[k]];
        /* The media in front of and behind the surface */
        if (body >= 0) {
            i32 before = top(depth, own, rank);
            if (front[k]) {
                enter(depth, own, body);
            } else {
                if (before < 0) before = body;  /* the ray began inside */
                leave(depth, own, body);
            }
            i32 after = top(depth, own, rank);
            n1 = before >= 0 ? index[before] : 1.0, n2 = after >= 0 ? index[after] : 1.0;
            real[k] = before != after, bends[k] = n1 != n2;
        }
        /* The angles before and behind it; grazing rays may pass a round surface */
        f64 cosine = -dot(d, N), along[3] = {d[0], d[1], d[2]};
        if (cosine <= 0.0) {
            f64 length = sqrt(1.0 - cosine * cosine);
            for (int c = 0; c < 3; c++) along[c] = (along[c] + cosine * N[c]) / length;
            cosine = 0.0;
        }
        f64 eta = n1 / n2, square_of = 1.0 - eta * eta * (1.0 - cosine * cosine);
        if (square_of <= 0.0 && 1.0 - square_of <= grazing[triangle[k]] && !by_fresnel[m]) square_of = 1e-12;
        /* How much is reflected and how much passes */
        if (by_fresnel[m]) {
            if (bends[k]) reflected = fresnel(n2 / n1, cosine);
            else if (body < 0 && ior[m] != 1.0 && (through[0] > 0.0 || through[1] > 0.0 || through[2] > 0.0)) reflected = fresnel(ior[m], cosine);
        }
        for (int c = 0; c < 3; c++) {
            on[c] = d[c];
            back[c] = !real[k] ? 0.0 : by_fresnel[m] ? share[m] * reflected : mirror[3 * (i64)m + c];
            pass[c] = !real[k] ? 0.0 : by_fresnel[m] ? through[c] * (1.0 - reflected) : through[c];
        }
        /* The direction behind it, or total reflection */
        if (!real[k] || !bends[k]) continue;
        if (square_of > 0.0) {
            refract(along, N, G, eta, cosine, square_of, on);
            continue;
        }
        for (int c = 0; c < 3; c++) {  /* total internal reflection: the light that would pass is reflected */
            back[c] = back[c] > through[c] ? back[c] : through[c];
            pass[c] = 0.0;
        }
    }
    return 0;
}

/* Fills the share of light that one straight crossing of each triangle lets through: 1 − α + α·kt. images: see
   Texture.alpha_texels; none of the materials here may need one that is ASKED. Sets `left` where triangles are pieces of
   larger ones, or materials are `asked`: these are not done. */
KERNEL(interfaces_factor,
       "source i32[T]  materials i32[s]  piece i32[p]  uvs f32[x,3,2]  alpha f64[m]  kt f64[m,3]  image i32[m]  "
       "asked bool[m]  images i64[i,j]  triangle i32[n]  u f32[n]  v f32[n]  factor f32[n,3]!  left bool[n]!"
       ";  j=10  p=0|p=T  x=0|x=s  0<=triangle<T;  0<=source<s  0<=materials<m  -1<=image<i")
i64 interfaces_factor(i64 T, i64 s, i64 p, i64 x, i64 m, i64 i, i64 j, i64 n, const i32 *source, const i32 *materials,
                      const i32 *piece, const f32 *uvs, const f64 *alpha, const f64 *kt, const i32 *image, const u8 *asked,
                      const i64 *images, const i32 *triangle, const f32 *u, const f32 *v, f32 *factor, u8 *left) {
    i64 count = 0;
    (void)T, (void)s, (void)m, (void)i;
    for (i64 k = 0; k < n; k++) {
        i64 t = triangle[k], material = materials[source[t]];
        left[k] = asked[material] || (p && piece[t] >= 0);
        if (left[k]) {
            count++;
            continue;
        }
        f64 there = alpha[material];
        f32 uv[2] = {0}, w = 1.0f - u[k] - v[k];
        if (x)
            for (int c = 0; c < 2; c++) {
                const f32 *at = uvs + 6 * (i64)source[t] + c;
                uv[c] = at[0] * w + at[2] * u[k] + at[4] * v[k];
            }
        if (image[material] >= 0) there *= alpha_at(images + j * image[material], uv);
        for (int c = 0; c < 3; c++) factor[3 * k + c] = (f32)(1.0 - there + there * kt[3 * material + c]);
    }
    return count;
}
