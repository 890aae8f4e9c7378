/* A set of lights for each of many nodes (light_sets.py): each set is stored once, and a row has the number of its
   set. */
#pragma once
#include "native.h"

typedef struct {
    u64 *words;   /* (room, W) */
    i64 *size;  /* the number of sets */
    i32 *table;  /* a hash table of their numbers; −1: free */
    u8 *number;   /* (rows, bytes), lowest byte first */
    i64 room, W, places, bytes;
} LightSets;

static inline i64 number_of(const LightSets *s, i64 row) {
    i64 number = 0;
    for (i64 b = 0; b < s->bytes; b++) number |= (i64)s->number[row * s->bytes + b] << (8 * b);
    return number;
}

static inline void give_number(LightSets *s, i64 row, i64 number) {
    for (i64 b = 0; b < s->bytes; b++) s->number[row * s->bytes + b] = (u8)(number >> (8 * b));
}

/* Returns the place of a set in the table, or the free place where it belongs. */
static inline i64 search_set(const LightSets *s, const u64 *lights) {
    u64 x = 0, mask = (u64)s->places - 1;
    for (i64 w = 0; w < s->W; w++) {
        x = (x ^ lights[w]) * SPREAD;
        x ^= x >> 29;
    }
    for (u64 place = (x ^ x >> 32) & mask;; place = (place + 1) & mask) {
        i64 number = s->table[place];
        if (number < 0) return (i64)place;
        if (!memcmp(s->words + number * s->W, lights, (size_t)s->W * sizeof *lights)) return (i64)place;
    }
}

/* Returns the number of the set with these words. A new set is added if necessary; then there must be room for it. */
static inline i64 number_for(LightSets *s, const u64 *lights) {
    i64 place = search_set(s, lights), number = s->table[place];
    if (number < 0) {
        number = (*s->size)++;
        memcpy(s->words + number * s->W, lights, (size_t)s->W * sizeof *lights);
        s->table[place] = (i32)number;
    }
    return number;
}
