/* Fresnel's equations (interfaces.c, aside.c). */
#pragma once
#include "../support/native.h"

/* Returns the reflectance for unpolarised light at an interface with relative index eta = n2/n1; 1 at total
   reflection. */
static inline f64 fresnel(f64 eta, f64 cosine) {
    f64 square_of = 1.0 - (1.0 - cosine * cosine) / (eta * eta);
    if (square_of <= 0.0) return 1.0;
    f64 t = sqrt(square_of);
    f64 s = (cosine - eta * t) / (cosine + eta * t), p = (eta * cosine - t) / (eta * cosine + t);
    return (s * s + p * p) / 2.0;
}
