/* One argument of a kernel, of any kind. For each kernel the build adds a function <name>_slots that takes an array of them:
   the lengths, and then the arguments (sources.py: calls). */
#pragma once
#include "native.h"

typedef union {
    i64 integer;
    u64 whole;
    f64 real;
    void *place;
} Slot;
