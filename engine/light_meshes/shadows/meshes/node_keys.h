/* Finds the row of a node (node_keys.py). A key has 8 bytes, 3 times 21 bits; further bits are in `far`. A hash
   table has 4 bytes for each place: a row and, in the bits above it, a part of the hash, so that few keys must be
   compared. */
#pragma once
#include "native.h"

#define EMPTY 0xFFFFFFFFu
#define LOW ((1u << 21) - 1)
#define HIGH ((1u << 11) - 1)

typedef struct {
    const i64 *base;
    u64 *near, *far;
    i64 has_far, size;
    u32 *table;
    u64 bits;
} Keys;

typedef struct {
    u64 near, far;
} Key;

static inline Key key_of(const i64 *base, const i32 *node) {
    u64 a = (u64)(node[0] - base[0]) & 0xFFFFFFFFu, b = (u64)(node[1] - base[1]) & 0xFFFFFFFFu;
    u64 c = (u64)(node[2] - base[2]) & 0xFFFFFFFFu;
    return (Key){(a & LOW) | (b & LOW) << 21 | (c & LOW) << 42, a >> 21 | b >> 21 << 11 | c >> 21 << 22};
}

/* Returns where a search begins; *mark: the bits of the hash that the table stores beside a row. */
static inline u64 place_of(Key key, i64 size, u64 *mark) {
    u64 x = (key.near ^ key.far * SPREAD_2) * SPREAD;
    x ^= x >> 32;
    x *= MIX;
    x ^= x >> 29;
    *mark = x & 0xFFFFFFFFu;
    return (x >> 32) * (u64)size >> 32;
}

/* Returns the row of a node, −1 if it has none; *place: its place in the table, or the one where it belongs. */
static inline i64 find_key(const Keys *keys, Key key, u64 *place) {
    u64 mark, at = place_of(key, keys->size, &mark), below = (u64)1 << keys->bits;
    mark = mark << keys->bits & 0xFFFFFFFFu;
    for (;;) {
        u32 entry = keys->table[at];
        u64 row = entry ^ mark;  /* the row, if the bits of the hash are equal */
        *place = at;
        if (entry == EMPTY) return -1;
        if (row < below && keys->near[row] == key.near && (!keys->has_far || keys->far[row] == key.far)) return (i64)row;
        if (++at == (u64)keys->size) at = 0;
    }
}

/* Gives the node that belongs in `place` a row. */
static inline void enter_key(Keys *keys, u64 place, Key key, i64 row) {
    u64 mark;
    place_of(key, keys->size, &mark);
    keys->near[row] = key.near;
    if (keys->has_far) keys->far[row] = key.far;
    keys->table[place] = (u32)(mark << keys->bits | (u64)row);
}
