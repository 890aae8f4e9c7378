/* Calls the kernels of a library for Windows as a file says, and compares what they write with what the file says.

   replay.exe KERNELS.dll CALLS; windows_kernels.py writes the file and compiles this. Of each call the file has: the
   kernel's name (64 bytes, padded with zeros), the number of arguments, what the kernel returned, and for each argument
   its kind, its size in bytes, its value or its contents before the call, and its contents after it. All numbers are 8
   bytes. One line a kernel tells how many calls and numbers differ; the exit code is 1 if any does. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <windows.h>

typedef int64_t i64;
typedef uint64_t u64;
enum { INTEGER, REAL, NOTHING, FLOATS, DOUBLES, BYTES, SAME };  /* kinds; SAME: the array of an earlier argument */
enum { MOST = 64 };  /* arguments; more than any kernel has, and what a kernel does not take it does not read */

/* Windows passes the first four arguments in registers, by their types, and all others in 8 bytes each. */
#define REST u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, \
             u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, \
             u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64, u64
#define A4(k) a[k], a[k + 1], a[k + 2], a[k + 3]
#define A20(k) A4(k), A4(k + 4), A4(k + 8), A4(k + 12), A4(k + 16)
#define CASE(mask, T0, T1, T2, T3, v0, v1, v2, v3) \
    case mask: return ((i64 (*)(T0, T1, T2, T3, REST))f)(v0, v1, v2, v3, A20(4), A20(24), A20(44));

static double real(u64 bits) {
    double x;
    memcpy(&x, &bits, 8);
    return x;
}

/* A call of f; bit k of `reals` says that argument k of the first four is a double. */
static i64 call(FARPROC f, const u64 *a, int reals) {
    double d0 = real(a[0]), d1 = real(a[1]), d2 = real(a[2]), d3 = real(a[3]);
    switch (reals) {
        CASE(0, u64, u64, u64, u64, a[0], a[1], a[2], a[3])
        CASE(1, double, u64, u64, u64, d0, a[1], a[2], a[3])
        CASE(2, u64, double, u64, u64, a[0], d1, a[2], a[3])
        CASE(3, double, double, u64, u64, d0, d1, a[2], a[3])
        CASE(4, u64, u64, double, u64, a[0], a[1], d2, a[3])
        CASE(5, double, u64, double, u64, d0, a[1], d2, a[3])
        CASE(6, u64, double, double, u64, a[0], d1, d2, a[3])
        CASE(7, double, double, double, u64, d0, d1, d2, a[3])
        CASE(8, u64, u64, u64, double, a[0], a[1], a[2], d3)
        CASE(9, double, u64, u64, double, d0, a[1], a[2], d3)
        CASE(10, u64, double, u64, double, a[0], d1, a[2], d3)
        CASE(11, double, double, u64, double, d0, d1, a[2], d3)
        CASE(12, u64, u64, double, double, a[0], a[1], d2, d3)
        CASE(13, double, u64, double, double, d0, a[1], d2, d3)
        CASE(14, u64, double, double, double, a[0], d1, d2, d3)
        CASE(15, double, double, double, double, d0, d1, d2, d3)
    }
    return 0;
}

static void take(FILE *file, void *to, size_t size) {
    if (size && fread(to, size, 1, file) != 1) {
        printf("the file of calls ends too early\n");
        exit(2);
    }
}

/* How many numbers of an array differ; *worst: the largest difference of two. */
static u64 differing(u64 kind, u64 size, const char *found, const char *wanted, double *worst) {
    u64 count = 0, step = kind == DOUBLES ? 8 : kind == FLOATS ? 4 : 1;
    for (u64 k = 0; k < size; k += step) {
        if (!memcmp(found + k, wanted + k, step)) continue;
        count++;
        double x = 0.0, y = 1.0;  /* whole numbers, and others that are no FLOATS or DOUBLES */
        if (kind == DOUBLES) memcpy(&x, found + k, 8), memcpy(&y, wanted + k, 8);
        if (kind == FLOATS) {
            float s, t;
            memcpy(&s, found + k, 4), memcpy(&t, wanted + k, 4);
            x = s, y = t;
        }
        if (!(fabs(x - y) <= *worst)) *worst = fabs(x - y);
    }
    return count;
}

static struct { char name[64]; u64 calls, wrong, numbers, of; double worst; } kernels[256];

int main(int argc, char **argv) {
    HMODULE library = argc == 3 ? LoadLibraryA(argv[1]) : NULL;
    FILE *file = argc == 3 ? fopen(argv[2], "rb") : NULL;
    if (!library || !file) {
        printf("the library or the file of calls cannot be opened\n");
        return 2;
    }
    int count = 0, wrong = 0;
    char name[64];
    while (fread(name, 64, 1, file) == 1) {
        u64 head[2], a[MOST] = {0}, kinds[MOST], sizes[MOST];
        char *wanted[MOST] = {0};
        int reals = 0, bad = 0;
        take(file, head, sizeof head);
        for (u64 k = 0; k < head[0]; k++) {
            take(file, &kinds[k], 8), take(file, &sizes[k], 8);
            if (kinds[k] < FLOATS) {
                take(file, &a[k], 8);
                if (kinds[k] == REAL && k < 4) reals |= 1 << k;
            } else if (kinds[k] == SAME) {
                a[k] = a[sizes[k]];
            } else {
                char *array = malloc(sizes[k] + 64);
                array += 64 - (u64)array % 64;
                wanted[k] = malloc(sizes[k] + 1);
                take(file, array, sizes[k]), take(file, wanted[k], sizes[k]);
                a[k] = (u64)array;
            }
        }
        FARPROC f = GetProcAddress(library, name);
        if (!f) {
            printf("%s: the library has none\n", name);
            return 2;
        }
        int at = 0;
        while (at < count && strcmp(kernels[at].name, name)) at++;
        if (at == count) strcpy(kernels[count++].name, name);
        i64 gave = call(f, a, reals);
        bad |= gave != (i64)head[1];
        for (u64 k = 0; k < head[0]; k++) {
            if (!wanted[k]) continue;
            u64 numbers = differing(kinds[k], sizes[k], (char *)a[k], wanted[k], &kernels[at].worst);
            kernels[at].numbers += numbers;
            kernels[at].of += sizes[k] / (kinds[k] == DOUBLES ? 8 : kinds[k] == FLOATS ? 4 : 1);
            bad |= numbers > 0;
            free(wanted[k]);  /* the array itself is left: its beginning is not known any more */
        }
        kernels[at].calls++, kernels[at].wrong += bad, wrong |= bad;
    }
    for (int k = 0; k < count; k++)
        printf("%s: %llu of %llu calls differ, in %llu of %llu numbers, by at most %.2g\n", kernels[k].name,
               kernels[k].wrong, kernels[k].calls, kernels[k].numbers, kernels[k].of, kernels[k].worst);
    return wrong;
}
