/* What receivers of a block reflect of lamps by their microfacets and fibres; part of shading.c. */
#pragma once
#include "shading_block.h"

/* F in channel j, as ggx.h has it; fifth: (1−c)⁵, s: `fresnel_share` at c. */
INLINE f64 reflectance(const Facets *f, int j, int k, f64 c, f64 fifth, f64 s) {
    f64 F = f->plain[j][k] + f->schlick[j][k] * fifth - f->edge[j][k] * (c * fifth * (1.0 - c)) + f->fresnel[j][k] * s;
    return F > 0.0 ? F : 0.0;
}

/* The share of a light's intensity that receiver k reflects by its facets, in each channel: f_att·π·D·G·F/(4·N·V).
   1/π is in the intensity. */
INLINE void facet_power(const Block *b, const Facets *f, Arriving a, int k, f64 *power) {
    f64 facing = a.cosine * a.inverse, toward = 1.0 + (2.0 * a.cosine * b->facing[k] - a.lobe) * a.inverse;
    toward = toward > 1e-9 ? toward : 1e-9;
    toward = toward < 2.0 ? toward : 2.0;
    f64 aa = f->alpha2[k], c = sqrt(0.5 * toward), half = facing + f->sight[k];
    f64 spread = 1.0 - half * half / (2.0 * toward) * (1.0 - aa), left = 1.0 - c, two = left * left;
    spread = spread > aa ? spread : aa;
    f64 shadowed = sqrt(aa + (1.0 - aa) * facing * facing);
    f64 one = a.power * aa / (spread * spread) * facing / (2.0 * (f->masked[k] * facing + f->sight[k] * shadowed));
    f64 fifth = two * two * left, s = fresnel_share(c, f->ior2[k], f->normal[k]);
    for (int j = 0; j < 3; j++) power[j] = a.cosine > 0.0 ? one * reflectance(f, j, k, c, fifth, s) : 0.0;
}

/* total += S·I·`facet_power`. */
INLINE void add_facets(int kind, const Source *s, const f64 (*S)[SIDE], const int *channel, const Block *b,
                       const Facets *f, f64 (*total)[SIDE]) {
    const f64 *red = S[channel[0]], *green = S[channel[1]], *blue = S[channel[2]];
    for (int k = 0; k < SIDE; k++) {
        f64 power[3];
        facet_power(b, f, arriving(kind, s, b, k), k, power);
        total[0][k] += red[k] * (power[0] * s->colour[0]);
        total[1][k] += green[k] * (power[1] * s->colour[1]);
        total[2][k] += blue[k] * (power[2] * s->colour[2]);
    }
}

/* `facet_power` of a lamp with a size, over I: the sum over rays to it. */
static void facets_sized(const Sized *s, const Block *b, const Facets *f, int k, f64 *power) {
    Ray rays[RAYS];
    Seen seen = {.alpha = sqrt(f->alpha2[k])};
    f64 P[3], Ns[3], eye[3], one[3];
    taken(b->P, k, P), taken(b->Ns, k, Ns), taken(b->eye, k, eye);
    memcpy(seen.N, Ns, sizeof Ns), memcpy(seen.V, eye, sizeof eye);
    int count = rays_to(s, &seen, P, rays);
    power[0] = power[1] = power[2] = 0.0;
    for (int i = 0; i < count; i++) {
        f64 cosine = dot3(Ns, rays[i].way), lobe = 2.0 * cosine * b->facing[k] - dot3(rays[i].way, eye);
        facet_power(b, f, (Arriving){1, rays[i].weight, 1.0, cosine, lobe}, k, one);
        for (int j = 0; j < 3; j++) power[j] += one[j];
    }
}

/* The same of receivers side by side, for which a lamp that is a ball is but one ray: `rays_to` with one_ray, the same
   operations in the same order, and so the same bits. done: for which; the others are left. */
static void facets_of_dots(const Sized *s, const Block *b, const Facets *f, f64 (*power)[SIDE], u8 *done) {
    f64 weight[SIDE], cosine[SIDE], lobe[SIDE], rr = s->radius * s->radius;
    int flat = s->kind == FACING;
    for (int k = 0; k < SIDE; k++) {
        f64 N[3] = {b->Ns[0][k], b->Ns[1][k], b->Ns[2][k]}, V[3] = {b->eye[0][k], b->eye[1][k], b->eye[2][k]};
        f64 d[3] = {s->c[0] - b->P[0][k], s->c[1] - b->P[1][k], s->c[2] - b->P[2][k]}, R[3], x[3], y[3], m[3], p[3], q[3];
        f64 far = dot3(d, d), inverse = 1.0 / sqrt(far), up = 2.0 * dot3(N, V), alpha = sqrt(f->alpha2[k]);
        f64 sine = flat ? s->radius / sqrt(far + rr) : s->radius * inverse, left = 1.0 - sine * sine;
        f64 tangent = sine / sqrt(left > 0.0 ? left : 0.0), over = 0.0, up_x = 0.0, up_y = 0.0;
        for (int j = 0; j < 3; j++) d[j] *= inverse, R[j] = up * N[j] - V[j];
        f64 along = dot3(R, d);
        for (int j = 0; j < 3; j++) x[j] = R[j] - along * d[j];
        f64 size = sqrt(dot3(x, x));
        for (int j = 0; j < 3; j++) x[j] /= size;
        y[0] = d[1] * x[2] - d[2] * x[1], y[1] = d[2] * x[0] - d[0] * x[2], y[2] = d[0] * x[1] - d[1] * x[0];
        for (int j = 0; j < 3; j++) over += (d[j] + V[j]) * N[j], up_x += x[j] * N[j], up_y += y[j] * N[j];
        f64 scale = 1.0 / (alpha * (over > 1e-3 ? over : 1e-3));
        for (int j = 0; j < 3; j++) {
            m[j] = (d[j] + V[j] - over * N[j]) * scale;
            f64 fall = N[j] + alpha * m[j];
            p[j] = scale * (y[j] - up_y * fall), q[j] = scale * (x[j] - up_x * fall);
        }
        f64 pp = dot3(p, p), qq = dot3(q, q), rate = pp > qq ? pp : qq;
        int small = (tangent <= 0.1) & (left > 0.0) & (size > 1e-6) & (far > 0.0) & (flat | (far > rr));
        done[k] = small & !(tangent * tangent * rate > 0.01 * (1.0 + dot3(m, m)));
        weight[k] = s->per_area * PI * tangent * tangent;
        cosine[k] = dot3(N, d), lobe[k] = 2.0 * cosine[k] * b->facing[k] - dot3(d, V);
    }
    for (int k = 0; k < SIDE; k++) {
        f64 one[3];
        facet_power(b, f, (Arriving){1, weight[k], 1.0, cosine[k], lobe[k]}, k, one);
        for (int j = 0; j < 3; j++) power[j][k] = one[j];
    }
}

static void add_facets_sized(const Source *source, const f64 (*S)[SIDE], const int *channel, const Block *b,
                             const Facets *f, f64 (*total)[SIDE]) {
    const Sized s = size_of(source);
    f64 small[3][SIDE];
    u8 done[SIDE] = {0};
    if (s.kind == BALL || s.kind == FACING) facets_of_dots(&s, b, f, small, done);
    for (int k = 0; k < SIDE; k++) {
        const f64 share[3] = {S[channel[0]][k], S[channel[1]][k], S[channel[2]][k]};
        f64 power[3];
        if (!(b->returns[k] & (GGX | COAT)) || (share[0] == 0.0 && share[1] == 0.0 && share[2] == 0.0)) continue;
        if (done[k]) taken(small, k, power);
        else facets_sized(&s, b, f, k, power);
        for (int j = 0; j < 3; j++) total[j][k] += share[j] * (power[j] * source->colour[j]);
    }
}

/* The share of a light's intensity that receiver k's fibres return, but for their colour. */
INLINE f64 fibres_power(const Block *b, Arriving a, int k) {
    f64 together = (2.0 * a.cosine * b->facing[k] - a.lobe) * a.inverse;
    return a.power * fibres_return(&b->fibres[k], a.cosine * a.inverse, together, b->facing[k]);
}

/* total += S·I·`fibres_power`. */
INLINE void add_fibres(int kind, const Source *s, const f64 (*S)[SIDE], const int *channel, const Block *b, f64 (*total)[SIDE]) {
    for (int k = 0; k < SIDE; k++) {
        if (!(b->returns[k] & SHEEN)) continue;
        f64 power = fibres_power(b, arriving(kind, s, b, k), k);
        for (int j = 0; j < 3; j++) total[j][k] += S[channel[j]][k] * (power * b->fibres[k].colour[j] * s->colour[j]);
    }
}

/* `fibres_power` of a lamp with a size, over I: the sum over rays to it, as of the widest highlight. */
static f64 fibres_sized(const Sized *s, const Block *b, int k) {
    Ray rays[RAYS];
    Seen seen = {.alpha = 1.0};
    f64 P[3], sum = 0.0;
    taken(b->P, k, P), taken(b->Ns, k, seen.N), taken(b->eye, k, seen.V);
    int count = rays_to(s, &seen, P, rays);
    for (int i = 0; i < count; i++) {
        f64 cosine = dot3(seen.N, rays[i].way), lobe = 2.0 * cosine * b->facing[k] - dot3(rays[i].way, seen.V);
        sum += fibres_power(b, (Arriving){1, rays[i].weight, 1.0, cosine, lobe}, k);
    }
    return sum;
}

static void add_fibres_sized(const Source *source, const f64 (*S)[SIDE], const int *channel, const Block *b,
                             f64 (*total)[SIDE]) {
    const Sized s = size_of(source);
    for (int k = 0; k < SIDE; k++) {
        const f64 share[3] = {S[channel[0]][k], S[channel[1]][k], S[channel[2]][k]};
        if (!(b->returns[k] & SHEEN) || (share[0] == 0.0 && share[1] == 0.0 && share[2] == 0.0)) continue;
        f64 power = fibres_sized(&s, b, k);
        for (int j = 0; j < 3; j++) total[j][k] += share[j] * (power * b->fibres[k].colour[j] * source->colour[j]);
    }
}

/* The lamp as if all its light came from its middle: for what is not summed over its face. */
static Source middle_of(const Source *s) {
    Source middle = *s;
    int skewed = s->axes[0] != 0.0 || s->axes[1] != 0.0 || s->axes[2] != 0.0;
    if (s->kind == SKY) middle.kind = SUN;
    else if (s->kind >= PLATE) middle.kind = skewed ? SKEWED_AREA : AREA;
    else if (s->kind >= BALL_SPOT) middle.kind = skewed ? SKEWED_SPOT : SPOT;
    else middle.kind = POINT;
    return middle;
}
