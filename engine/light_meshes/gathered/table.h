/* A hash table from 64-bit keys to numbers in the order in which they came. */
#pragma once
#include "native.h"

typedef struct {
    i32 *slots;    /* numbers, −1: free */
    u64 *entered;  /* keys by their numbers */
    i64 *size;     /* how many there are */
    i64 m, room;   /* slots, a power of two; room in `entered` */
} Slots;

static inline u64 spread(u64 key) {
    key = (key ^ key >> 31) * SPREAD;
    return key ^ key >> 29;
}

/* The number of a key, which gets the next one if it has none; −1: there is no room. */
static inline i64 number_of(const Slots *s, u64 key) {
    u64 mask = (u64)s->m - 1, at = spread(key) & mask;
    while (s->slots[at] >= 0 && s->entered[s->slots[at]] != key) at = (at + 1) & mask;
    if (s->slots[at] < 0) {
        if (*s->size == s->room) return -1;
        s->entered[*s->size] = key;
        __atomic_store_n(s->slots + at, (i32)(*s->size)++, __ATOMIC_RELEASE);
    }
    return s->slots[at];
}

/* The number of a key; −1: it has none, or another thread has just given it one. Other threads may add keys. */
static inline i64 known_number(const i32 *slots, i64 m, const u64 *entered, i64 room, u64 key) {
    u64 mask = (u64)m - 1, at = spread(key) & mask;
    i32 of;
    for (; (of = __atomic_load_n(slots + at, __ATOMIC_ACQUIRE)) >= 0; at = (at + 1) & mask)
        if (of < room && entered[of] == key) return of;
    return -1;
}
