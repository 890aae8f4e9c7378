/* Shadow rays in packets for Embree (embree.py), as its C interface wants them (rtcore_ray.h of Embree 4). */
#pragma once
#include "tracer.h"

#define ALIGNED _Alignas(64)

enum { WIDEST = 16 };  /* shadow rays at once, at most */
enum { X, Y, Z, NEAREST, DX, DY, DZ, TIME, END, MASK, ID, FLAGS, ROWS };  /* of a packet, which has a value a ray */

typedef void (*Occluded)(const i32 *valid, void *scene, f32 *rays, void *arguments);

/* What traces packets of shadow rays, and the frame in which they are traced. */
typedef struct {
    Occluded function;
    void *scene;
    i64 wide;
    const f64 *centre;
    f64 scale, reach;
} Field;

/* Rays that are traced together, as soon as there are `wide` of them. */
typedef struct {
    ALIGNED f32 rays[ROWS * WIDEST];
    ALIGNED i32 valid[WIDEST];
    i64 count, from[WIDEST];  /* from: what its maker knows a ray by */
    i64 to[WIDEST];
} Packet;

static inline void empty_packet(Packet *p, i64 wide) {
    memset(p, 0, sizeof *p);
    memset(p->rays + MASK * wide, 255, (size_t)wide * sizeof *p->rays);
}

/* Adds a ray to a packet that is not full; returns whether it is full then. */
static inline int add_ray(const Field *f, Packet *p, const f32 *start, const f64 *end, int directional, i64 closed, i64 from,
                          i64 to) {
    i64 k = p->count++, wide = f->wide;
    f32 way[3], t = way_to(start, end, directional, f->reach, closed, way);
    for (i64 j = 0; j < 3; j++) p->rays[(X + j) * wide + k] = start[j], p->rays[(DX + j) * wide + k] = way[j];
    p->rays[END * wide + k] = t, p->from[k] = from, p->to[k] = to;
    return p->count == wide;
}

/* Traces a packet, which is empty then; returns the bits of its rays that meet nothing. */
static inline u32 free_rays(const Field *f, Packet *p) {
    u32 found = 0;
    for (i64 k = 0; k < f->wide; k++) p->valid[k] = k < p->count ? -1 : 0;
    f->function(p->valid, f->scene, p->rays, 0);
    for (i64 k = 0; k < p->count; k++) found |= (u32)!(p->rays[END * f->wide + k] < 0.0f) << k;
    p->count = 0;
    return found;
}

/* Kernels of embree.c that other files call, too. */
EXPORT i64 embree_closest(i64 n, u64 function, u64 scene, const f32 *o, const f32 *d, f32 *t, i32 *triangle, f32 *u, f32 *v);
EXPORT i64 embree_occluded(i64 n, u64 function, i64 wide, u64 scene, const f32 *o, const f32 *d, const f32 *t, u8 *blocked);
