/* Straight rays of light through surfaces that let it pass: what `Tracer.transmittance` does step by step for many rays, ray by
   ray and without Python between the steps, and with the same result. */
#include "../rays/geometry.h"
#include "../rays/packets.h"
#include "straight.h"

enum { BLOCK = 256 };  /* rays that are made before they are traced */

/* The surfaces of a scene and what they let through; see the kernels that are called here for what each array is. */
typedef struct {
    i64 V, T, I, s, x, y, z, M, i, j, b;
    const f32 *vertices;
    const i32 *triangles, *instance, *source;
    const f64 *normal_matrix;
    const u8 *mirrored;
    const f32 *corner_normals, *uvs;
    const i32 *materials, *piece;
    const f64 *cut, *alpha, *kt;
    const i32 *image;
    const u8 *asked;
    const i64 *images, *first;
    const i32 *body;
    const u8 *inside_out;
    const f64 *bodies_ior, *index;
    const u8 *by_fresnel;
    const f64 *centre;
    f64 scale;
    u64 closest, sheets;
    const i32 *original;
} Glass;

/* A ray on its way. start, end: of the straight segment; o, d, t: what is left of it, for Embree. */
typedef struct {
    f64 start[3], end[3], state[STATE];
    f32 o[3], d[3], t, *through;
    i32 triangle;
    f32 u, v;
    int sun, turns;
} Ray;

/* Whether other sheets are where this triangle is, so that Embree does not tell all crossings. */
static int stacked(const Glass *g, i64 t) { return g->first && g->first[t + 1] > g->first[t]; }

/* aside_cross, for a crossing of one ray. */
static void turn_at(const Glass *g, Ray *r) {
    f64 P[3], Ng[3], Ns[3], way[3], from[3], left = 0.0;
    f32 uv[2];
    i32 material, hit;
    u8 front;
    i64 row = 0;
    for (int j = 0; j < 3; j++) way[j] = r->end[j] - r->start[j], from[j] = r->start[j] * g->scale + g->centre[j];
    f64 length = sqrt(dot(way, way));
    for (int j = 0; j < 3; j++) way[j] /= length;
    geometry_surface(g->V, g->T, g->I, g->s, g->x, g->y, g->z, 1, 1, g->centre, g->scale, g->vertices, g->triangles,
                     g->instance, g->source, g->normal_matrix, g->mirrored, g->corner_normals, g->uvs, g->materials,
                     g->piece, g->cut, 0, &r->triangle, &r->u, &r->v, from, way, P, Ng, Ns, uv, &material, &hit, &front);
    for (int j = 0; j < 3; j++) left += square(r->end[j] * g->scale + g->centre[j] - P[j]);
    left = r->sun ? 1.0 : sqrt(left);
    aside_cross(g->T, g->b, g->M, 1, 1, g->body, g->inside_out, g->bodies_ior, g->index, g->by_fresnel, &r->triangle,
                &material, &front, Ns, way, &left, &row, r->state);
}

/* Follows a ray that nothing stops from crossing to crossing. Returns 0 if it meets a surface of which Python has to ask. */
static int follow(const Glass *g, Ray *r) {
    f64 passed = 0.0, until;
    i32 last = -1, near = 0;
    f32 length = r->t;
    for (int j = 0; j < STATE; j++) r->state[j] = -1.0;
    for (i64 crossing = 0;; crossing++) {
        f32 factor[3];
        u8 new, left;
        embree_closest(1, g->closest, g->sheets, r->o, r->d, &r->t, &r->triangle, &r->u, &r->v);
        if (r->triangle < 0) return 1;
        if (!crossing)
            for (int j = 0; j < 3; j++) {
                r->start[j] = r->o[j];
                r->end[j] = r->start[j] + (f64)r->d[j] * (f64)length;
            }
        if (g->original) r->triangle = g->original[r->triangle];
        if (stacked(g, r->triangle)) return 0;
        tracer_cross(g->V, g->T, 1, g->vertices, g->triangles, g->instance, &r->triangle, r->start, r->end, r->o, r->d,
                     &r->t, &passed, &last, &near, &new, &until);
        if (new) {
            interfaces_factor(g->T, g->s, g->y, g->x, g->M, g->i, g->j, 1, g->source, g->materials, g->piece, g->uvs,
                              g->alpha, g->kt, g->image, g->asked, g->images, &r->triangle, &r->u, &r->v, factor, &left);
            if (left) return 0;
            for (int c = 0; c < 3; c++) r->through[c] *= factor[c];
            if (r->turns) turn_at(g, r);
        }
        if (!(r->through[0] > 0.0f || r->through[1] > 0.0f || r->through[2] > 0.0f) || !(r->t > 0.0f)) return 1;
    }
}

/* Fills `through` with what arrives on the segments from origin[origin_of] to position[target_of]; see
   Tracer.transmittance. Sets `left` where Python has to ask: where sheets are in one place (`first`: of Stacks), or a material is
   ASKED; see interfaces_factor. body … by_fresnel: see aside_cross, None if nothing is turned aside. radius: half of
   the width of each lamp. light: of each segment; None: nothing is turned aside. original: the numbers of the triangles
   of `sheets`; sheets is 0 if there are none. on: the triangles on which origins lie. Returns how many are left. */
KERNEL(straight_light,
       "vertices f32[V,3]  triangles i32[T,3]  instance i32[T]  source i32[T]  normal_matrix f64[I,3,3]  mirrored bool[I]  "
       "corner_normals f32[s,3,3]  uvs f32[x,3,2]  materials i32[s]  piece i32[y]  cut f64[z,3,2]  alpha f64[M]  kt f64[M,3]  "
       "image i32[M]  asked bool[M]  images i64[i,j]  first i64[K]?  body i32[T]?  inside_out bool[b]?  "
       "bodies_ior f64[b]?  index f64[M]?  by_fresnel bool[M]?  radius f64[L]?  least f64  "
       "occluded u64  wide i64  stops u64  closest u64  sheets u64  original i32[o]?  centre f64[3]  scale f64  reach f64  "
       "origin f64[m,3]  normal f64[m,3]?  origin_of i32[n]  position f64[q,3]  directional bool[q]  target_of i32[n]  "
       "closed i64  on i32[m]?  light i32[n]?  through f32[n,3]!  left bool[n]!"
       ";  j=10  x=0|x=s  y=0|y=T  0<wide<=16  0<=origin_of<m  0<=target_of<q  0<=on<T  0<=light<L"
       ";  0<=triangles<V  0<=instance<I  0<=source<s  0<=materials<M  -1<=piece<z  -1<=image<i  -1<=body<b  0<=original<T")
i64 straight_light(i64 V, i64 T, i64 I, i64 s, i64 x, i64 y, i64 z, i64 M, i64 i, i64 j, i64 K, i64 b, i64 L, i64 o, i64 m,
                   i64 n, i64 q, const f32 *vertices, const i32 *triangles, const i32 *instance, const i32 *source,
                   const f64 *normal_matrix, const u8 *mirrored, const f32 *corner_normals, const f32 *uvs,
                   const i32 *materials, const i32 *piece, const f64 *cut, const f64 *alpha, const f64 *kt,
                   const i32 *image, const u8 *asked, const i64 *images, const i64 *first, const i32 *body,
                   const u8 *inside_out, const f64 *bodies_ior, const f64 *index, const u8 *by_fresnel,
                   const f64 *radius, f64 least, u64 occluded, i64 wide, u64 stops, u64 closest, u64 sheets,
                   const i32 *original, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *normal,
                   const i32 *origin_of, const f64 *position, const u8 *directional, const i32 *target_of, i64 closed,
                   const i32 *on, const i32 *light, f32 *through, u8 *left) {
    Glass g = {V, T, I, s, x, y, z, M, i, j, b, vertices, triangles, instance, source, normal_matrix, mirrored,
               corner_normals, uvs, materials, piece, cut, alpha, kt, image, asked, images, first, body, inside_out,
               bodies_ior, index, by_fresnel, centre, scale, closest, sheets, original};
    f32 from[3 * BLOCK], way[3 * BLOCK], t[BLOCK];
    u8 blocked[BLOCK];
    int turns = light && body && inside_out && bodies_ior && index && by_fresnel && radius;
    i64 total = 0;
    (void)L, (void)o;
    if (first && K != T + 1) return OUTSIDE;
    for (i64 begin = 0; begin < n; begin += BLOCK) {
        i64 count = n - begin < BLOCK ? n - begin : BLOCK;
        tracer_segments(m, count, q, centre, scale, reach, origin, normal, origin_of + begin, position, directional,
                        target_of + begin, closed, from, way, t);
        embree_occluded(count, occluded, wide, stops, from, way, t, blocked);
        for (i64 k = 0; k < count; k++) {
            i64 at = begin + k;
            Ray r = {.t = t[k], .through = through + 3 * at, .sun = directional[target_of[at]], .turns = turns};
            for (int c = 0; c < 3; c++) r.through[c] = blocked[k] ? 0.0f : 1.0f;
            left[at] = 0;
            if (blocked[k] || !sheets) continue;
            memcpy(r.o, from + 3 * k, sizeof r.o), memcpy(r.d, way + 3 * k, sizeof r.d);
            left[at] = (on && stacked(&g, on[origin_of[at]])) || !follow(&g, &r);
            total += left[at];
            if (turns && !left[at]) aside_dim(1, r.state, radius + light[at], least, r.through);
        }
    }
    return total;
}
