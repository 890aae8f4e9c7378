/* What lies over the lobes of a surface, and dims it: a layer of fibres (sheen), and below it a clear coat; as in Cycles.

   T. Zeltner, B. Burley, M. J.-Y. Chiang: Practical multiple-scattering sheen using linearly transformed cosines, SIGGRAPH
   2022 Talks. To an eye the fibres return the share R of light from everywhere. What of it comes from a direction (x, y, z), z
   along the normal and x to the side of the eye, is a cosine that is stretched by two numbers A and B:

       f·cos = R/π · z · (A / ((A·x + B·z)² + (A·y)² + z²))².  */
#pragma once
#include "ggx.h"
#include "sheen_table.h"

/* What one receiver's fibres return: A, B, R by the weight and colour in each channel; across: the sine of the eye. */
typedef struct {
    f64 a, b, across, colour[3];
} Fibres;

static inline f64 sheen_entry(int part, f64 roughness, f64 sight) {
    int r, c;
    f64 a, b;
    place_in(roughness, SHEEN_SIDE, &r, &a), place_in(sight, SHEEN_SIDE, &c, &b);
    const float(*t)[SHEEN_SIDE] = sheen_table[part];
    return (1.0 - a) * ((1.0 - b) * t[r][c] + b * t[r][c + 1]) + a * ((1.0 - b) * t[r + 1][c] + b * t[r + 1][c + 1]);
}

/* Of light from everywhere, what the sheen of a material's row returns in each channel to an eye at the cosine `facing`;
   returns which share gets past it. */
static inline f64 sheen_albedo(const f64 *m, f64 facing, f64 *albedo) {
    albedo[0] = albedo[1] = albedo[2] = 0.0;
    if (m[G_SHEEN] <= 0.0) return 1.0;
    if (m[G_ON_SHEEN] > 0.0) facing = m[G_ON_SHEEN];
    f64 R = m[G_SHEEN] * sheen_entry(2, m[G_SHEEN_ROUGHNESS], facing), most = 0.0;
    for (int j = 0; j < 3; j++) {
        albedo[j] = m[G_COUNTS] * R * m[G_SHEEN_TINT + j];
        most = R * m[G_SHEEN_TINT + j] > most ? R * m[G_SHEEN_TINT + j] : most;
    }
    return most < 1.0 ? 1.0 - most : 0.0;
}

static inline Fibres fibres_of(const f64 *m, f64 facing) {
    Fibres f = {.across = sqrt(facing < 1.0 && facing > -1.0 ? 1.0 - facing * facing : 0.0)};
    f.a = sheen_entry(0, m[G_SHEEN_ROUGHNESS], facing), f.b = sheen_entry(1, m[G_SHEEN_ROUGHNESS], facing);
    sheen_albedo(m, facing, f.colour);
    if (f.a < 1e-5) f.a = 1.0, f.colour[0] = f.colour[1] = f.colour[2] = 0.0;
    return f;
}

/* π·f·cos over R, of light at the cosine z; together: the cosine between light and eye, facing: between normal and eye. */
static inline f64 fibres_return(const Fibres *f, f64 z, f64 together, f64 facing) {
    if (z <= 0.0) return 0.0;
    f64 x = f->across > 1e-6 ? (together - facing * z) / f->across : 0.0, aside = 1.0 - z * z - x * x;
    f64 turned = f->a * x + f->b * z, length = turned * turned + f->a * f->a * (aside > 0.0 ? aside : 0.0) + z * z;
    return z * square(f->a / length);
}

/* A material's coat as a material of its own, a dielectric below which the diffuse light is. */
static inline void coat_row(const f64 *m, f64 *coat) {
    for (int i = 0; i < G_COLUMNS; i++) coat[i] = 0.0;
    coat[G_ON] = coat[G_TINT] = coat[G_TINT + 1] = coat[G_TINT + 2] = 1.0, coat[G_COMPENSATION] = m[G_COAT_SEVERAL];
    coat[G_ROUGHNESS] = m[G_COAT_ROUGHNESS], coat[G_IOR] = m[G_COAT_IOR], coat[G_DIELECTRIC] = coat[G_LAYERED] = m[G_COAT];
}

/* Which share of the light gets past the fibres, and counts, for the coat's own lobe. */
static inline void to_coat(const f64 *m, f64 facing, f64 *through) {
    f64 back[3], past = sheen_albedo(m, facing, back);
    through[0] = through[1] = through[2] = past * m[G_COUNTS];
}

/* Which share of the light gets past a coat. Where light that its microfacets reflect several times does not count, it dims as
   if it were smooth: older releases of Cycles have it so. */
static inline f64 past_coat(const f64 *m, const f64 *tables, f64 on_coat, f64 sight) {
    f64 coat[G_COLUMNS];
    if (m[G_COAT_SEVERAL] == 0.0) return 1.0 - m[G_COAT] * held(fresnel_of(sight, square(m[G_COAT_IOR])), 0.0, 1.0);
    coat_row(m, coat);
    return below(coat, tables, on_coat);
}

/* Which share of the light gets past fibres and coat, for what is below. What a coat absorbs goes by the way in it (Beer).
   on_coat: the cosine of the eye to the coat's normal, which nodes of what is below do not bend; the row may say another,
   of a coat that has nodes of its own. */
static inline void to_base(const f64 *m, const f64 *tables, f64 facing, f64 on_coat, f64 *through) {
    f64 back[3], past = sheen_albedo(m, facing, back);
    through[0] = through[1] = through[2] = past;
    if (m[G_COAT] <= 0.0) return;
    if (m[G_ON_COAT] > 0.0) on_coat = m[G_ON_COAT];
    f64 sight = held(on_coat, LEAST_SIGHT, 1.0), left = past * past_coat(m, tables, on_coat, sight), way = 1.0 / sqrt(1.0 - (1.0 - square(sight)) / square(m[G_COAT_IOR]));
    for (int j = 0; j < 3; j++) {
        f64 tint = m[G_COAT_TINT + j];
        through[j] = left * (1.0 + m[G_COAT] * ((tint == 1.0 ? 1.0 : pow(tint, way)) - 1.0));
    }
}

/* Of a colour that is dimmed by what lies over it, as it is by itself. */
static inline void undimmed(const f64 *m, const f64 *tables, f64 facing, f64 on_coat, f64 *colour) {
    f64 through[3], left = below(m, tables, facing);
    to_base(m, tables, facing, on_coat, through);
    for (int j = 0; j < 3; j++) colour[j] /= left * through[j] > 1e-6 ? left * through[j] : 1.0;
}
