/* Embree's own interface, by the addresses of its functions, which Python found in the library (embree.py): rays that are
   ready made, and rays that are made here on the way. Layouts as in Embree 4's rtcore_ray.h. */
#include "around.h"
#include "packets.h"

typedef struct {
    f32 from[3], nearest, way[3], time, end;
    u32 mask, id, flags;
    f32 normal[3], u, v;
    u32 triangle, geometry, instances[2], spare[4];
} __attribute__((aligned(16))) RayHit;

typedef void (*Closest)(void *scene, RayHit *ray, void *arguments);

/* The first triangle on each ray, or −1, where on it, and how far (at t, where the rays' ends stood). */
KERNEL(embree_closest,
       "function u64  scene u64  o f32[n,3]  d f32[n,3]  t f32[n]!  triangle i32[n]!  u f32[n]!  v f32[n]!")
i64 embree_closest(i64 n, u64 function, u64 scene, const f32 *o, const f32 *d, f32 *t, i32 *triangle, f32 *u, f32 *v) {
    Closest closest = (Closest)(uintptr_t)function;
    RayHit ray;
    memset(&ray, 0, sizeof ray);
    ray.mask = ~(u32)0;
    for (i64 k = 0; k < n; k++) {
        memcpy(ray.from, o + 3 * k, sizeof ray.from), memcpy(ray.way, d + 3 * k, sizeof ray.way);
        ray.nearest = 0.0f, ray.end = t[k], ray.u = ray.v = 0.0f;
        ray.triangle = ray.geometry = ray.instances[0] = ray.instances[1] = ~(u32)0;
        closest((void *)(uintptr_t)scene, &ray, 0);
        triangle[k] = (i32)ray.triangle, u[k] = ray.u, v[k] = ray.v, t[k] = ray.end;
    }
    return 0;
}

enum { TOGETHER = 8 };  /* camera rays that are traced as one packet */
static const f32 AT_AN_EDGE = 1e-5f;  /* in barycentrics: several times what they are rounded by */
static const u32 COHERENT = 1u << 16;  /* RTC_RAY_QUERY_FLAG_COHERENT */

/* A packet of rays and what each meets. */
typedef struct {
    f32 rays[ROWS * TOGETHER], normal[3 * TOGETHER], u[TOGETHER], v[TOGETHER];
    u32 triangle[TOGETHER], geometry[TOGETHER], instances[2 * TOGETHER], spare[4 * TOGETHER];
} __attribute__((aligned(64))) PacketHit;

typedef struct {
    u32 flags, features;
    void *context, *filter, *intersect;
    f32 width;
} __attribute__((aligned(16))) HowToIntersect;

typedef void (*ClosestOfPacket)(const i32 *valid, void *scene, PacketHit *rays, HowToIntersect *how);

/* Traces up to TOGETHER rays as one packet. At an edge two triangles can be equally far, and which of them counts would be up
   to the other rays; so a ray that meets an edge is traced alone. Where two surfaces cross, it would have to be equally far from
   both to the last bit. */
static void closest_together(i64 count, u64 function, u64 packets, u64 scene, const f32 *o, const f32 *d, f32 *t,
                             i32 *triangle, f32 *u, f32 *v) {
    PacketHit p;
    HowToIntersect how = {.flags = COHERENT, .features = ~(u32)0};
    ALIGNED i32 valid[TOGETHER];
    memset(&p, 0, sizeof p);
    memset(p.rays + MASK * TOGETHER, 255, TOGETHER * sizeof *p.rays);
    memset(p.triangle, 255, sizeof p.triangle), memset(p.geometry, 255, sizeof p.geometry);
    memset(p.instances, 255, sizeof p.instances);
    for (i64 k = 0; k < TOGETHER; k++) {
        i64 from = k < count ? k : 0;
        valid[k] = k < count ? -1 : 0;
        for (i64 j = 0; j < 3; j++)
            p.rays[(X + j) * TOGETHER + k] = o[3 * from + j], p.rays[(DX + j) * TOGETHER + k] = d[3 * from + j];
        p.rays[END * TOGETHER + k] = t[from];
    }
    ((ClosestOfPacket)(uintptr_t)packets)(valid, (void *)(uintptr_t)scene, &p, &how);
    for (i64 k = 0; k < count; k++) {
        f32 edge = p.u[k] < p.v[k] ? p.u[k] : p.v[k], other = 1.0f - p.u[k] - p.v[k];
        if ((i32)p.triangle[k] >= 0 && (edge < other ? edge : other) < AT_AN_EDGE) {
            embree_closest(1, function, scene, o + 3 * k, d + 3 * k, t + k, triangle + k, u + k, v + k);
            continue;
        }
        triangle[k] = (i32)p.triangle[k], u[k] = p.u[k], v[k] = p.v[k], t[k] = p.rays[END * TOGETHER + k];
    }
}

/* Whether anything is on each ray. function: traces packets of `wide` rays, 4, 8 or 16. */
KERNEL(embree_occluded, "function u64  wide i64  scene u64  o f32[n,3]  d f32[n,3]  t f32[n]  blocked bool[n]!"
       ";  0<wide<=16")
i64 embree_occluded(i64 n, u64 function, i64 wide, u64 scene, const f32 *o, const f32 *d, const f32 *t, u8 *blocked) {
    Occluded occluded = (Occluded)(uintptr_t)function;
    ALIGNED f32 rays[ROWS * WIDEST] = {0};
    ALIGNED i32 valid[WIDEST];
    if (wide > WIDEST) return 0;
    memset(rays + MASK * wide, 255, (size_t)wide * sizeof *rays);
    for (i64 first = 0; first < n; first += wide) {
        i64 count = n - first < wide ? n - first : wide;
        for (i64 k = 0; k < wide; k++) {
            i64 from = first + (k < count ? k : 0);
            valid[k] = k < count ? -1 : 0;
            for (i64 j = 0; j < 3; j++)
                rays[(X + j) * wide + k] = o[3 * from + j], rays[(DX + j) * wide + k] = d[3 * from + j];
            rays[END * wide + k] = t[from];
        }
        occluded(valid, (void *)(uintptr_t)scene, rays, 0);
        for (i64 k = 0; k < count; k++) blocked[first + k] = rays[END * wide + k] < 0.0f;
    }
    return 0;
}

enum { BLOCK = 256 };  /* rays that are made before they are traced: so few stay near the processor */

/* tracer_rays, and the first triangle on each: −1: none. */
KERNEL(embree_closest_of,
       "function u64  scene u64  centre f64[3]  scale f64  reach f64  origin f64[n,3]  direction f64[n,3]  "
       "normal f64[n,3]?  length f64[n]?  triangle i32[n]!  u f32[n]!  v f32[n]!")
i64 embree_closest_of(i64 n, u64 function, u64 scene, const f64 *centre, f64 scale, f64 reach, const f64 *origin,
                      const f64 *direction, const f64 *normal, const f64 *length, i32 *triangle, f32 *u, f32 *v) {
    f32 o[3 * BLOCK], d[3 * BLOCK], t[BLOCK];
    for (i64 k = 0; k < n; k += BLOCK) {
        i64 count = n - k < BLOCK ? n - k : BLOCK;
        tracer_rays(count, centre, scale, reach, origin + 3 * k, direction + 3 * k, normal ? normal + 3 * k : 0,
                    length ? length + k : 0, o, d, t);
        embree_closest(count, function, scene, o, d, t, triangle + k, u + k, v + k);
    }
    return 0;
}

/* Returns how many of the rays from k on make a packet: those of a row of pixels that follow each other up to the next
   multiple of TOGETHER, counted from the picture's left border. So packets do not depend on tiles. */
static i64 of_packet(i64 k, i64 n, const i64 *pixel, i64 x, i64 wide, i64 samples) {
    i64 from = pixel[k], rank = (x + from / samples % wide) * samples + from % samples;
    i64 left = wide * samples - from % (wide * samples), end = k + TOGETHER - rank % TOGETHER, i = k + 1;
    if (end > n) end = n;
    if (end > k + left) end = k + left;
    while (i < end && pixel[i] == from + i - k) i++;
    return i - k;
}

/* The same as embree_closest_of for rays from the camera through rows of `wide` pixels with `samples` rays each. pixel: the
   number of each ray. x: the first pixel of the rows. packets: traces TOGETHER rays. */
KERNEL(embree_closest_of_pixels,
       "function u64  packets u64  scene u64  pixel i64[n]  x i64  wide i64  samples i64  centre f64[3]  scale f64  "
       "reach f64  origin f64[n,3]  direction f64[n,3]  length f64[n]?  triangle i32[n]!  u f32[n]!  v f32[n]!"
       ";  0<=pixel  0<=x  0<wide  0<samples")
i64 embree_closest_of_pixels(i64 n, u64 function, u64 packets, u64 scene, const i64 *pixel, i64 x, i64 wide, i64 samples,
                             const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *direction,
                             const f64 *length, i32 *triangle, f32 *u, f32 *v) {
    f32 o[3 * BLOCK], d[3 * BLOCK], t[BLOCK];
    for (i64 k = 0, end = 0; k < n; k = end) {
        i64 size[BLOCK], sizes = 0;
        while (end < n && end - k <= BLOCK - TOGETHER)
            size[sizes] = of_packet(end, n, pixel, x, wide, samples), end += size[sizes++];
        tracer_rays(end - k, centre, scale, reach, origin + 3 * k, direction + 3 * k, 0, length ? length + k : 0, o, d, t);
        for (i64 p = 0, i = 0; p < sizes; i += size[p++])
            closest_together(size[p], function, packets, scene, o + 3 * i, d + 3 * i, t + i, triangle + k + i, u + k + i,
                             v + k + i);
    }
    return 0;
}

/* tracer_segments, and whether anything is on each. */
KERNEL(embree_occluded_of,
       "function u64  wide i64  scene u64  centre f64[3]  scale f64  reach f64  origin f64[m,3]  normal f64[m,3]?  "
       "origin_of i32[n]  position f64[q,3]  directional bool[q]  target_of i32[n]  closed i64  blocked bool[n]!"
       ";  0<wide<=16  0<=origin_of<m  0<=target_of<q")
i64 embree_occluded_of(i64 m, i64 n, i64 q, u64 function, i64 wide, u64 scene, const f64 *centre, f64 scale, f64 reach,
                       const f64 *origin, const f64 *normal, const i32 *origin_of, const f64 *position,
                       const u8 *directional, const i32 *target_of, i64 closed, u8 *blocked) {
    f32 o[3 * BLOCK], d[3 * BLOCK], t[BLOCK];
    for (i64 k = 0; k < n; k += BLOCK) {
        i64 count = n - k < BLOCK ? n - k : BLOCK;
        tracer_segments(m, count, q, centre, scale, reach, origin, normal, origin_of + k, position, directional,
                        target_of + k, closed, o, d, t);
        embree_occluded(count, function, wide, scene, o, d, t, blocked + k);
    }
    return 0;
}

/* The first triangle on each of the rays along `local`, turned to normals M, from points P, which are on surfaces; x = r·d.
   turn: see turned_to. */
KERNEL(embree_around,
       "function u64  scene u64  centre f64[3]  scale f64  reach f64  P f64[r,3]  M f64[r,3]  turn f64[r,2]?  local f64[d,3]  "
       "triangle i32[x]!  u f32[x]!  v f32[x]!"
       ";  x=r*d")
i64 embree_around(i64 r, i64 d, i64 x, u64 function, u64 scene, const f64 *centre, f64 scale, f64 reach, const f64 *P,
                  const f64 *M, const f64 *turn, const f64 *local, i32 *triangle, f32 *u, f32 *v) {
    f64 origin[3 * BLOCK], direction[3 * BLOCK], normal[3 * BLOCK];
    f32 from[3 * BLOCK], way[3 * BLOCK], t[BLOCK];
    (void)x;
    for (i64 k = 0; k < r; k++) {
        Turned axes = turned_to(M + 3 * k, turn ? turn + 2 * k : 0);
        for (i64 i = 0; i < d; i += BLOCK) {
            i64 count = d - i < BLOCK ? d - i : BLOCK, at = k * d + i;
            for (i64 c = 0; c < count; c++) {
                along(&axes, local + 3 * (i + c), direction + 3 * c);
                memcpy(origin + 3 * c, P + 3 * k, 3 * sizeof *P), memcpy(normal + 3 * c, M + 3 * k, 3 * sizeof *M);
            }
            tracer_rays(count, centre, scale, reach, origin, direction, normal, 0, from, way, t);
            embree_closest(count, function, scene, from, way, t, triangle + at, u + at, v + at);
        }
    }
    return 0;
}

static void find_lit(const Field *f, Packet *rays, i64 W, u64 *found) {
    for (u32 lit = free_rays(f, rays); lit; lit &= lit - 1) set_bit(found + rays->from[lowest(lit)] * W, rays->to[lowest(lit)]);
}

/* Sets the bits of found for the lights of first..last that points in free space see, of those in `asked` and `among`;
   BLOCK points at a time and light by light, so that neighbouring rays have similar directions. Returns how many rays there
   were. */
KERNEL(embree_lit,
       "function u64  wide i64  scene u64  centre f64[3]  scale f64  reach f64  origin f64[n,3]  position f64[q,3]  "
       "directional bool[q]  asked u64[n,W]  among u64[W]  first i64  last i64  found u64[n,W]!"
       ";  W=words(q)  0<wide<=16  0<=first")
i64 embree_lit(i64 n, i64 q, i64 W, u64 function, i64 wide, u64 scene, const f64 *centre, f64 scale, f64 reach,
               const f64 *origin, const f64 *position, const u8 *directional, const u64 *asked, const u64 *among,
               i64 first, i64 last, u64 *found) {
    Field field = {(Occluded)(uintptr_t)function, (void *)(uintptr_t)scene, wide, centre, scale, reach};
    Packet rays;
    f32 start[3 * BLOCK];
    i64 total = 0;
    if (wide > WIDEST) return 0;
    empty_packet(&rays, wide);
    for (i64 begin = 0; begin < n; begin += BLOCK) {
        i64 count = n - begin < BLOCK ? n - begin : BLOCK;
        for (i64 p = 0; p < count; p++) start_of(centre, scale, reach, origin + 3 * (begin + p), 0, start + 3 * p);
        for (i64 i = first; i < last && i < q; i++) {
            f64 end[3];
            if (!has(among, i)) continue;
            end_of(centre, scale, position + 3 * i, directional[i], end);
            for (i64 p = 0; p < count; p++) {
                if (!has(asked + (begin + p) * W, i)) continue;
                total++;
                if (add_ray(&field, &rays, start + 3 * p, end, directional[i], 0, begin + p, i)) find_lit(&field, &rays, W, found);
            }
        }
    }
    if (rays.count) find_lit(&field, &rays, W, found);
    return total;
}

static void find_seen(const Field *f, Packet *rays, u8 *seen) {
    i64 count = rays->count;
    u32 found = free_rays(f, rays);
    for (i64 k = 0; k < count; k++) seen[rays->to[k]] = found >> k & 1;
}

/* Fills seen[k] of the rows k of `target` from start[p,0] to end[p] that are not set yet: whether nothing is between
   point p and position[target[k]]. Begins with state[0], the next point, and stops after about `most` rays; state[1]
   counts them. */
KERNEL(embree_near,
       "function u64  wide i64  scene u64  centre f64[3]  scale f64  reach f64  origin f64[n,3]  normal f64[n,3]  "
       "position f64[q,3]  start i64[n,s]  end i64[n]  target i32[c]  most i64  seen bool[c]!  state i64[2]!"
       ";  0<wide<=16  0<=start<=c  0<=end<=c  0<=state;  0<=target<q")
i64 embree_near(i64 n, i64 q, i64 s, i64 c, u64 function, i64 wide, u64 scene, const f64 *centre, f64 scale, f64 reach,
                const f64 *origin, const f64 *normal, const f64 *position, const i64 *start, const i64 *end,
                const i32 *target, i64 most, u8 *seen, i64 *state) {
    Field field = {(Occluded)(uintptr_t)function, (void *)(uintptr_t)scene, wide, centre, scale, reach};
    Packet rays;
    i64 total = 0, p = state[0];
    (void)q, (void)c;
    if (wide > WIDEST) return 0;
    empty_packet(&rays, wide);
    for (; p < n && total < most; p++) {
        f32 from[3];
        f64 to[3];
        int ready = 0;
        for (i64 k = start[p * s]; k < end[p]; k++) {
            if (seen[k]) continue;
            if (!ready) start_of(centre, scale, reach, origin + 3 * p, normal + 3 * p, from), ready = 1;
            end_of(centre, scale, position + 3 * (i64)target[k], 0, to);
            total++;
            if (add_ray(&field, &rays, from, to, 0, 1, p, k)) find_seen(&field, &rays, seen);
        }
    }
    if (rays.count) find_seen(&field, &rays, seen);
    state[0] = p, state[1] += total;
    return 0;
}
