/* Bob Jenkins' hash (lookup3), of one to four words or numbers: what Blender's textures choose their random numbers by. */
#pragma once
#include "../support/native.h"

static inline u32 turned(u32 x, int k) { return x << k | x >> (32 - k); }

/* Jenkins' final mixing of three words. */
static inline u32 hash_end(u32 a, u32 b, u32 c) {
    c ^= b, c -= turned(b, 14);
    a ^= c, a -= turned(c, 11);
    b ^= a, b -= turned(a, 25);
    c ^= b, c -= turned(b, 16);
    a ^= c, a -= turned(c, 4);
    b ^= a, b -= turned(a, 14);
    c ^= b, c -= turned(b, 24);
    return c;
}

/* A word from `count` words, 1 to 4. */
static inline u32 hash_words(const u32 *k, int count) {
    u32 a = 0xdeadbeefu + ((u32)count << 2) + 13u, b = a, c = a;
    a += k[0];
    if (count > 1) b += k[1];
    if (count > 2) c += k[2];
    if (count > 3) {
        a -= c, a ^= turned(c, 4), c += b;
        b -= a, b ^= turned(a, 6), a += c;
        c -= b, c ^= turned(b, 8), b += a;
        a -= c, a ^= turned(c, 16), c += b;
        b -= a, b ^= turned(a, 19), a += c;
        c -= b, c ^= turned(b, 4), b += a;
        a += k[3];
    }
    return hash_end(a, b, c);
}

/* A number from 0 to 1 from `count` numbers, by their bits. */
static inline f32 hash_numbers(const f32 *x, int count) {
    u32 k[4];
    memcpy(k, x, sizeof(u32) * (size_t)count);
    return (f32)hash_words(k, count) / (f32)0xFFFFFFFFu;
}
