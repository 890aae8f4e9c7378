/* The store of node values (node_store.py): rows for nodes, and the bits of lights in bytes. */
#include "light_sets.h"
#include "node_keys.h"

/* Returns the bits of the lights 64·w… in a row of B bytes. */
static inline u64 word_at(const u8 *row, i64 B, i64 w) {
    u64 word = 0;
    for (i64 b = 8 * w; b < B && b < 8 * w + 8; b++) word |= (u64)row[b] << (8 * (b - 8 * w));
    return word;
}

static inline void put_word(u8 *row, i64 B, i64 w, u64 word) {
    for (i64 b = 8 * w; b < B && b < 8 * w + 8; b++) row[b] = (u8)(word >> (8 * (b - 8 * w)));
}

/* Looks up nodes from state[0] on, until all are done or some array is too short. Fills their rows, and todo: the
   lights that no thread has begun yet, of `wanted`: the nodes that have such. state: the next node, the number of rows,
   whether everything that is needed is known, and the number of `wanted`. */
KERNEL(store_claim,
       "base i64[3]  near u64[k]!  far u64[f]!  table u32[t]!  key_bits u64  words u64[r,W]  number u8[q,y]  "
       "bits u8[v,B]!  room i64  nodes i32[n,3]  need u64[n,W]  state i64[4]!  rows u32[n]!  wanted i64[n]!  "
       "todo u64[n,W]!"
       ";  f=0|f=k  room<=k  room<=q  room<=v  room<t  key_bits<=32  0<=state")
i64 store_claim(i64 k, i64 f, i64 t, i64 r, i64 W, i64 q, i64 y, i64 v, i64 B, i64 n, const i64 *base, u64 *near,
                u64 *far, u32 *table, u64 key_bits, u64 *words, u8 *number, u8 *bits, i64 room, const i32 *nodes,
                const u64 *need, i64 *state, u32 *rows, i64 *wanted, u64 *todo) {
    Keys keys = {base, near, far, f > 0, t, table, key_bits};
    LightSets known = {words, 0, 0, number, r, W, 0, y};
    i64 at = state[0], count = state[1], settled = state[2], begun = state[3];
    (void)k, (void)q, (void)v;
    for (; at < n; at++) {
        Key key = key_of(base, nodes + 3 * at);
        if (key.far && !keys.has_far) break;
        u64 place;
        i64 row = find_key(&keys, key, &place);
        if (row < 0) {
            if (count == room) break;
            row = count++;
            enter_key(&keys, place, key, row);
        }
        rows[at] = (u32)row;

        /* Claim the lights that are missing and that no thread has begun */
        const u64 *has_value = words + number_of(&known, row) * W;
        u64 any = 0;
        for (i64 w = 0; w < W; w++) {
            u64 missing = need[at * W + w] & ~has_value[w];
            todo[begun * W + w] = 0;
            if (missing) {
                u64 word = word_at(bits + row * B, B, w);
                settled = 0;
                todo[begun * W + w] = missing & ~word;
                any |= missing & ~word;
                put_word(bits + row * B, B, w, word | missing);
            }
        }
        if (any) wanted[begun++] = at;
    }
    state[0] = at, state[1] = count, state[2] = settled, state[3] = begun;
    return 0;
}

KERNEL(store_put, "bits u8[v,B]!  rows u32[n]  todo u8[n,E]  found u8[n,E]"
       ";  B<=E  rows<v")
i64 store_put(i64 v, i64 B, i64 n, i64 E, u8 *bits, const u32 *rows, const u8 *todo, const u8 *found) {
    (void)v;
    for (i64 k = 0; k < n; k++) {
        u8 *row = bits + rows[k] * B;
        for (i64 b = 0; b < B; b++) row[b] = (u8)((row[b] & ~todo[k * E + b]) | found[k * E + b]);
    }
    return 0;
}

/* Records that the rows from `done` on know the lights in todo. Stops if there is no room for a new set; returns the
   next row. */
KERNEL(store_learn,
       "words u64[r,W]!  size i64[1]!  table i32[t]!  number u8[q,y]!  rows u32[n]  todo u64[n,W]  lights u64[W]!  done i64"
       ";  power(t)  r<t  0<=size<=r  0<=done  rows<q")
i64 store_learn(i64 r, i64 W, i64 t, i64 q, i64 y, i64 n, u64 *words, i64 *size, i32 *table, u8 *number,
                const u32 *rows, const u64 *todo, u64 *lights, i64 done) {
    LightSets known = {words, size, table, number, r, W, t, y};
    i64 before = -1, now = -1;
    (void)q;
    for (i64 k = done; k < n; k++) {
        if (*size == r) return k;
        i64 old = number_of(&known, rows[k]);
        int same = old == before;  /* most rows have the same set as the row before */
        before = old;
        for (i64 w = 0; w < W; w++) {
            u64 word = words[old * W + w] | todo[k * W + w];
            same &= word == lights[w];
            lights[w] = word;
        }
        if (!same) now = number_for(&known, lights);
        give_number(&known, rows[k], now);
    }
    return n;
}

KERNEL(store_settled, "words u64[r,W]  number u8[q,y]  rows u32[n]  need u64[n,W]"
       ";  rows<q")
i64 store_settled(i64 r, i64 W, i64 q, i64 y, i64 n, u64 *words, u8 *number, const u32 *rows, const u64 *need) {
    LightSets known = {words, 0, 0, number, r, W, 0, y};
    (void)q;
    for (i64 k = 0; k < n; k++) {
        const u64 *has_value = words + number_of(&known, rows[k]) * W;
        for (i64 w = 0; w < W; w++)
            if (need[k * W + w] & ~has_value[w]) return 0;
    }
    return 1;
}

KERNEL(store_gather, "bits u8[v,B]  rows u32[n]  out u8[n,E]!"
       ";  B<=E  rows<v")
i64 store_gather(i64 v, i64 B, i64 n, i64 E, const u8 *bits, const u32 *rows, u8 *out) {
    (void)v;
    for (i64 k = 0; k < n; k++) memcpy(out + k * E, bits + rows[k] * B, (size_t)B);
    return 0;
}

KERNEL(store_drop_begun, "bits u8[v,B]!  words u64[r,W]  number u8[q,y]  count i64"
       ";  0<=count  count<=v  count<=q")
i64 store_drop_begun(i64 v, i64 B, i64 r, i64 W, i64 q, i64 y, u8 *bits, u64 *words, u8 *number, i64 count) {
    LightSets known = {words, 0, 0, number, r, W, 0, y};
    (void)v, (void)q;
    for (i64 row = 0; row < count; row++)
        for (i64 w = 0; w < W; w++)
            put_word(bits + row * B, B, w, word_at(bits + row * B, B, w) & words[number_of(&known, row) * W + w]);
    return 0;
}

/* Fills out (n,W): bit i is bit source[i] of old (n,V); 0 if source[i] is −1. */
KERNEL(store_moved_bits, "old u64[n,V]  source i32[L]  out u64[n,W]!"
       ";  W=words(L)  -1<=source<64*V")
i64 store_moved_bits(i64 n, i64 V, i64 L, i64 W, const u64 *old, const i32 *source, u64 *out) {
    for (i64 i = 0; i < L; i++) {
        i64 j = source[i];
        if (j < 0) continue;
        for (i64 k = 0; k < n; k++) out[k * W + (i >> 6)] |= has(old + k * V, j) << (i & 63);
    }
    return 0;
}
