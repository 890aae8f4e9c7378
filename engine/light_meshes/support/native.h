/* Definitions for all kernels: short names of types, and the declaration of a kernel's arguments for Python.

   KERNEL(name, "P f64[n,3] h f64 S f32[n,L]!") precedes i64 name(…). native.py reads this text from the library, and
   every call is checked against it (calls.c): names, types and shapes (a letter is the same length wherever it occurs). ! marks an
   array that is written, ? an array that may be None. The function takes first the lengths, as i64, in the order in
   which their letters first appear, and then the arguments in order, arrays as pointers to contiguous memory. It
   returns an i64; OUTSIDE if it meets an index that is outside of its array, which Python gets as an error.

   Conditions follow behind a semicolon, without spaces in them: "…;  W=words(L)  s=K+1  0<=row<n  0<h<inf". Their words are
   letters of lengths, numbers that are arguments, and arrays, all values of which are meant; | is "or". power(m): m is a
   power of two; rising(start): no row of start falls; tree(child,n): see calls.h. Behind a second semicolon stand those
   that would take long, of arrays that Python or another kernel has made right: they are tested by `Kernel.of`, by calls
   that fail, and with LIGHT_MESHES_CHECKS=all, as the tests have it. */
#pragma once
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef int8_t i8;
typedef int32_t i32;
typedef int64_t i64;
typedef uint8_t u8;
typedef uint16_t u16;
typedef uint32_t u32;
typedef uint64_t u64;
typedef float f32;
typedef double f64;

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define OUTSIDE INT64_MIN
#define PI 3.14159265358979323846
#define JOINED(a, b) a##b
#define TAKES(name) JOINED(name, _takes)
#define KERNEL(name, takes) EXPORT const char TAKES(name)[] = takes; EXPORT

/* Sets of lights as 64-bit words: light i is bit i & 63 of word i >> 6 (bits.py). */
static inline u64 has(const u64 *words, i64 i) { return words[i >> 6] >> (i & 63) & 1; }
static inline u64 bit(i64 i) { return (u64)1 << (i & 63); }
static inline void set_bit(u64 *words, i64 i) { words[i >> 6] |= bit(i); }
static inline void clear_bit(u64 *words, i64 i) { words[i >> 6] &= ~bit(i); }
static inline int lowest(u64 word) { return __builtin_ctzll(word); }

/* Odd numbers by which hashes multiply, to spread bits: xxHash's, and SplitMix64's. */
#define SPREAD 0x9E3779B185EBCA87u
#define SPREAD_2 0xC2B2AE3D27D4EB4Fu
#define SPREAD_3 0x165667B19E3779F9u
#define MIX 0xBF58476D1CE4E5B9u

static inline f64 square(f64 x) { return x * x; }
static inline f64 squared_distance(const f64 *a, const f64 *b) {
    return square(a[0] - b[0]) + square(a[1] - b[1]) + square(a[2] - b[2]);
}
