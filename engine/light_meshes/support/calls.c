/* Calls of kernels from Python (native.py): checks that the arguments are what a kernel takes, and calls it while other
   Python threads run. The same checks in Python would take longer than many kernels do.

   Python's functions come by their addresses, so this library serves every Python. The places of an array's data, shape,
   type and flags are those of numpy's C interface; native.py looks whether they are right before it uses this file. */
#include "calls.h"

enum { DIMENSIONS = 4, MOST = 64, TOGETHER = 8 };  /* axes of an array; lengths and arguments of a kernel; kernels */
enum { ARRAY, INTEGER, UNSIGNED, REAL };  /* kinds of arguments */

/* What is known of one argument. type: the address of its numpy.dtype. length: of each axis, where it is fixed, else
   −1 − its number. */
typedef struct {
    i64 kind, type, axes, flags, optional, length[DIMENSIONS];
} Argument;

/* A kernel as native.py describes it, in one array of i64. Of its `count` arguments the first `given` are known; then so are
   their values, and the lengths that they say (the others are −1). otherwise: a Python function for calls that are not as
   expected, which raises the error. */
typedef struct {
    i64 slots, otherwise, lengths, count, given;
    i64 known[MOST], values[MOST];
    Argument arguments[];
} Called;

typedef struct Object {
    i64 references;
    const struct Object *type;
} Object;

typedef struct {
    Object head;
    void *data;
    int axes;
    i64 *shape, *strides;
    Object *base, *type;
    int flags;
} Array;

/* Python's functions and objects, in the order of native.py. */
static struct {
    i64 (*as_integer)(const Object *);
    u64 (*as_unsigned)(const Object *);
    f64 (*as_real)(const Object *);
    Object *(*failed)(void);
    void (*forget)(void);
    void *(*leave)(void);
    void (*enter)(void *);
    Object *(*integer)(i64);
    Object *(*call)(Object *, const Object *const *, size_t, Object *);
    const Object *nothing, *array;
} python;

KERNEL(calls_know, "functions u64[n]")
i64 calls_know(i64 n, const u64 *functions) {
    if ((size_t)n * sizeof *functions != sizeof python) return 1;
    memcpy(&python, functions, sizeof python);
    return 0;
}

/* Whether an array is what is wanted; fills in the lengths that are not known yet. */
static int fits(const Argument *wanted, const Object *given, i64 *lengths) {
    const Array *a = (const Array *)given;
    if (given->type != python.array || (i64)(intptr_t)a->type != wanted->type || a->axes != wanted->axes) return 0;
    if ((a->flags & wanted->flags) != wanted->flags) return 0;
    for (i64 j = 0; j < wanted->axes; j++) {
        i64 length = wanted->length[j];
        if (length < 0) {
            i64 *known = lengths - 1 - length;
            if (*known < 0) *known = a->shape[j];
            length = *known;
        }
        if (a->shape[j] != length) return 0;
    }
    return 1;
}

/* Takes one argument; returns whether it is what is wanted. */
static int take(const Argument *wanted, const Object *given, i64 *lengths, Slot *slot) {
    switch (wanted->kind) {
        case INTEGER: slot->integer = python.as_integer(given); break;
        case UNSIGNED: slot->whole = python.as_unsigned(given); break;
        case REAL: slot->real = python.as_real(given); break;
        default:
            if (wanted->optional && given == python.nothing) slot->place = 0;
            else if (!fits(wanted, given, lengths)) return 0;
            else slot->place = ((const Array *)given)->data;
            return 1;
    }
    if (!python.failed()) return 1;
    python.forget();
    return 0;
}

/* Fills slots with the lengths and the arguments of a kernel; returns whether these are what it takes. */
static int filled(const Called *k, const Object *const *given, Slot *slots) {
    i64 lengths[MOST];
    memcpy(lengths, k->known, (size_t)k->lengths * sizeof *lengths);
    for (i64 i = 0; i < k->given; i++) slots[k->lengths + i].integer = k->values[i];
    for (i64 i = k->given; i < k->count; i++)
        if (!take(k->arguments + i, given[i - k->given], lengths, slots + k->lengths + i)) return 0;
    for (i64 i = 0; i < k->lengths; i++) slots[i].integer = lengths[i] < 0 ? 0 : lengths[i];
    return 1;
}

static i64 run(const Called *k, const Slot *slots) {
    return ((i64 (*)(const Slot *))(uintptr_t)k->slots)(slots);
}

/* A Python function (METH_FASTCALL) for all kernels; self: an array that holds its `Called`. */
EXPORT Object *calls_kernel(const Object *self, const Object *const *given, i64 count) {
    const Called *k = ((const Array *)self)->data;
    Slot slots[2 * MOST];
    if (count != k->count - k->given || !filled(k, given, slots))
        return python.call((Object *)(intptr_t)k->otherwise, given, (size_t)count, 0);
    void *thread = python.leave();
    i64 result = run(k, slots);
    python.enter(thread);
    return python.integer(result);
}

/* A Python function for several kernels, one after the other. self: the class of arrays that hold a `Called`. given: an
   array (TOGETHER,) for the results, and for each kernel the array that holds its `Called`, and its arguments. Returns how
   many kernels were called: none if some call is not as expected. */
EXPORT Object *calls_together(const Object *self, const Object *const *given, i64 count) {
    const Called *kernels[TOGETHER];
    Slot slots[TOGETHER][2 * MOST];
    i64 *results = ((const Array *)given[0])->data, n = 0, at = 1;
    for (; at < count && n < TOGETHER; n++) {
        if (given[at]->type != self) return python.integer(0);
        const Called *k = kernels[n] = ((const Array *)given[at++])->data;
        if (k->count - k->given > count - at || !filled(k, given + at, slots[n])) return python.integer(0);
        at += k->count - k->given;
    }
    if (at != count) return python.integer(0);
    void *thread = python.leave();
    for (i64 i = 0; i < n; i++) results[i] = run(kernels[i], slots[i]);
    python.enter(thread);
    return python.integer(n);
}
