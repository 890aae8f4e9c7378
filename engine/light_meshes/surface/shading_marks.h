/* Which receivers of a block a light reaches: part of shading.c and clusters.c. */
#pragma once
#include "shading_block.h"

/* `mark` for lamps with a size; FOR_KIND calls it by this name. */
static void mark_sized(const Source *source, u64 own, u64 colour, int unlit, const Block *b, u64 *bits) {
    const Sized s = size_of(source);
    u8 above[SIDE], facing[SIDE];
    if ((s.kind == BALL_SPOT || s.kind == FACING_SPOT) && passes_by(&s, b)) return;
    reach_block(&s, b->P, b->Ng, above), reach_block(&s, b->P, b->Ns, facing);
    for (int k = 0; k < SIDE; k++) {
        int faces = (source->diffuse & ((b->returns[k] & colour) != 0)) | (source->glossy & ((b->returns[k] & colour << 6) != 0));
        int gloss = source->glossy & ((b->returns[k] & colour << 3) != 0);
        if (above[k] && (unlit | gloss | (faces & facing[k]))) bits[k] |= own;
    }
}

/* Sets the light's bit for the receivers that it reaches. */
INLINE void mark(int kind, const Source *s, u64 own, u64 colour, i64 unlit, const Block *b, u64 *bits) {
    u64 facing = (s->diffuse ? colour : 0) | (s->glossy ? colour << 6 : 0), phong = s->glossy ? colour << 3 : 0;
    for (int k = 0; k < SIDE; k++) {
        Arriving a = arriving(kind, s, b, k);
        i64 faces = (b->returns[k] & facing) != 0, gloss = (b->returns[k] & phong) != 0;
        i64 lit = a.lit & (unlit | (faces & (a.cosine > 0.0)) | (gloss & (a.lobe > 0.0)));
        bits[k] |= lit ? own : 0;
    }
}
