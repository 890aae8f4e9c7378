/* Four numbers at once, in whatever registers the processor has. The results are those of four single operations. */
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
