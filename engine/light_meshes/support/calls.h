/* One argument of a kernel, of any kind. For each kernel the build adds a function <name>_slots that takes an array of them:
   the lengths, and then the arguments; and <name>_broken, which tests the kernel's conditions (declarations.py). */
#pragma once
#include "native.h"

typedef union {
    i64 integer;
    u64 whole;
    f64 real;
    void *place;
} Slot;

typedef __int128 wide;

/* The least and the largest of an array's values; of an empty one ±infinity, or the ends of 64 bits. Where one of them is not
   a number, all comparisons are false. */
typedef struct {
    i64 least, most;
} Wholes;

typedef struct {
    f64 least, most;
} Reals;

#define RANGE(T)                                                                                   \
    static inline Wholes range_##T(const void *place, i64 count) {                                 \
        const T *x = place;                                                                        \
        if (!count) return (Wholes){INT64_MAX, INT64_MIN};                                         \
        T least = x[0], most = x[0];                                                               \
        for (i64 k = 1; k < count; k++) least = x[k] < least ? x[k] : least, most = x[k] > most ? x[k] : most; \
        return (Wholes){(i64)least, (i64)most};                                                    \
    }
RANGE(i8)
RANGE(u8)
RANGE(u16)
RANGE(i32)
RANGE(u32)
RANGE(i64)

#define RANGE_OF_REALS(T)                                                                          \
    static inline Reals range_##T(const void *place, i64 count) {                                  \
        const T *x = place;                                                                        \
        T least = (T)INFINITY, most = (T)-INFINITY;                                                \
        int wrong = 0;                                                                             \
        for (i64 k = 0; k < count; k++) {                                                          \
            least = x[k] < least ? x[k] : least, most = x[k] > most ? x[k] : most;                 \
            wrong |= x[k] != x[k];                                                                 \
        }                                                                                          \
        return wrong ? (Reals){NAN, NAN} : (Reals){least, most};                                   \
    }
RANGE_OF_REALS(f32)
RANGE_OF_REALS(f64)

/* How many words of 64 bits a set of lights has. */
static inline i64 words(i64 lights) { return lights / 64 + (lights % 64 > 0); }

/* Whether x is a power of two, as sizes of hash tables are. */
static inline int power(i64 x) { return x > 0 && !(x & (x - 1)); }

/* Whether the numbers of each row never fall. */
static inline int rising(const void *place, i64 rows, i64 length) {
    const i64 *x = place;
    int falls = 0;
    for (i64 r = 0; r < rows; r++)
        for (i64 k = 1; k < length; k++) falls |= x[r * length + k] < x[r * length + k - 1];
    return !falls;
}

/* Whether rows (first, count) are a tree: a leaf has the `count` of `items` from `first` on, at least one; a node without a
   count has two halves, first and first + 1, which come behind it. */
static inline int tree(const void *place, i64 nodes, i64 two, i64 items) {
    const i64 *child = place;
    int wrong = two != 2;
    for (i64 k = 0; !wrong && k < nodes; k++) {
        i64 first = child[2 * k], count = child[2 * k + 1];
        wrong = count ? first < 0 || count < 0 || first > items || count > items - first : first <= k || first >= nodes - 1;
    }
    return !wrong;
}
