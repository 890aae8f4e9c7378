/* The kernel of textures.c, included once for each type T of texels. */

/* Sets colour[rows] to the texture at uv[rows]. gathered: texels are not those of the whole image, but those that
   `textures_needed` names. */
KERNEL(NAME(textures_look),
       "texels " T_NAME "[h,w,c]  height i64  width i64  gathered i64  first i64  step i64  linear f32[l]  weighing i64  divides i64  straight f32[l]  "
       "matrix f64[3,3]?  interpolation i64  extension i64  uv f32[n,2]  rows i64[r]  colour f64[n,C]!")
i64 NAME(textures_look)(i64 h, i64 w, i64 c, i64 l, i64 n, i64 r, i64 C, const T *texels, i64 height, i64 width,
                        i64 gathered, i64 first, i64 step,
                        const f32 *linear, i64 weighing, i64 divides, const f32 *straight, const f64 *matrix,
                        i64 interpolation, i64 extension, const f32 *uv, const i64 *rows, f64 *colour) {
    Look look = {height, width, c, first, step, weighing, divides, interpolation, extension, linear, straight, matrix};
    (void)n, (void)h, (void)w;
    for (i64 k = 0; k < r; k++) {
        f64 *out = colour + C * rows[k], total = 0.0;
        Place place = place_of(&look, uv + 2 * rows[k]);
        /* Blend the texels around the place */
        for (i64 j = 0; j < C; j++) out[j] = 0.0;
        for (int at = 0; at < place.side * place.side; at++) {
            int dx = at % place.side, dy = at / place.side;
            f64 weight = place.across[dx] * place.up[dy];
            if (weight == 0.0) continue;
            i64 i = wrap(place.x + dx, width, extension), j = wrap(place.y + dy, height, extension);
            if (i < 0 || j < 0) continue;
            const T *texel = texels + (gathered ? k * place.side * place.side + at : j * width + i) * c;
            if (weighing >= 0) {
                weight *= l ? straight[(i64)texel[weighing]] : (f32)texel[weighing];
                total += weight;
            }
            for (i64 k2 = 0; k2 < C; k2++) {
                T value = texel[first + step * k2];
                out[k2] += weight * (l ? linear[(i64)value] : (f32)value);
            }
        }
        if (divides && total > 0.0)
            for (i64 j = 0; j < C; j++) out[j] /= total;
        finish(&look, C, out);
    }
    return 0;
}
