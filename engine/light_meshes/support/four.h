/* Four numbers at once, or eight of single precision, in whatever registers the processor has. The results are those of
   single operations. */
#pragma once
#include "native.h"

typedef f64 Four __attribute__((vector_size(32)));
typedef i64 FourTests __attribute__((vector_size(32)));

static inline Four four_of(const f64 *x) {
    Four v;
    memcpy(&v, x, sizeof v);
    return v;
}

/* Which of four tests are true, as bits. */
static inline u32 bits_of(FourTests t) {
#ifdef __AVX__
    return (u32)__builtin_ia32_movmskpd256((Four)t);
#else
    return (u32)((t[0] & 1) | (t[1] & 2) | (t[2] & 4) | (t[3] & 8));
#endif
}

/* a where a test is true, elsewhere b. */
static inline Four four_where(FourTests test, Four a, Four b) { return (Four)((test & (FourTests)a) | (~test & (FourTests)b)); }

static inline Four four_roots(Four x) {
    return (Four){sqrt(x[0]), sqrt(x[1]), sqrt(x[2]), sqrt(x[3])};
}

typedef f32 Eight __attribute__((vector_size(32)));
typedef i32 EightTests __attribute__((vector_size(32)));

static inline Eight eight_of(const f32 *x) {
    Eight v;
    memcpy(&v, x, sizeof v);
    return v;
}

/* Which of eight tests are true, as bits. */
static inline u32 eight_bits(EightTests t) {
#ifdef __AVX__
    return (u32)__builtin_ia32_movmskps256((Eight)t);
#else
    u32 bits = 0;
    for (int i = 0; i < 8; i++) bits |= (u32)(t[i] & 1) << i;
    return bits;
#endif
}
