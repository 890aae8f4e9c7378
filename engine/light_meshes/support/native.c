/* The hash of the sources from which this library was compiled, and what the processor can do. */
#include "native.h"

#ifndef SOURCES
#define SOURCES ""
#endif

EXPORT const char sources_digest[] = SOURCES;

#if defined(__x86_64__)
#include <cpuid.h>

/* Returns whether processor and system support AVX2 and the other features of x86-64-v3: FMA, BMI, LZCNT, MOVBE,
   F16C. */
static int avx2(void) {
    u32 a, b, c, d, low, high;
    u32 wanted = bit_FMA | bit_OSXSAVE | bit_AVX | bit_MOVBE | bit_F16C, more = bit_AVX2 | bit_BMI | bit_BMI2;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & wanted) != wanted) return 0;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));  /* does the system save the wide registers? */
    if ((low & 6) != 6) return 0;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & more) != more) return 0;
    return __get_cpuid(0x80000001, &a, &b, &c, &d) && (c & bit_LZCNT);
}
#else
static int avx2(void) { return 0; }
#endif

/* Returns 1 if the library for processors with AVX2 can be used. */
KERNEL(processor_has_avx2, "")
i64 processor_has_avx2(void) { return avx2(); }
