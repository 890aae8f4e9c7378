/* The kernel of textures.c, included once for each type T of texels. */

/* Sets colour[rows] to the texture at uv[rows]. gathered: texels are not those of the whole image, but those that
   `textures_needed` names. */
KERNEL(NAME(textures_look),
       "texels " T_NAME "[h,w,c]  height i64  width i64  gathered i64  first i64  step i64  colours f32[l]  weighing i64  weighted i64  divides i64  straight f32[l]  "
       "matrix f64[3,3]?  decoded f32[d]?  interpolation i64  extension i64  uv f32[n,2]  rows i64[r]  colour f64[n,C]!"
       ";  0<height  0<width  gathered=1|h=height  gathered=1|w=width  0<=first  0<=step  first+step*C-step<c  "
       "weighing<c  gathered=0|interpolation=2|4*r<=h*w  gathered=0|interpolation<2|16*r<=h*w  " TABLE "  0<=rows<n")
i64 NAME(textures_look)(i64 h, i64 w, i64 c, i64 l, i64 d, i64 n, i64 r, i64 C, const T *texels, i64 height, i64 width,
                        i64 gathered, i64 first, i64 step,
                        const f32 *colours, i64 weighing, i64 weighted, i64 divides, const f32 *straight, const f64 *matrix,
                        const f32 *decoded, i64 interpolation, i64 extension, const f32 *uv, const i64 *rows, f64 *colour) {
    Look look = {height, width, c, first, step, weighing, weighted, divides, interpolation, extension, colours, straight,
                 matrix, decoded, d - 1};
    (void)n, (void)h, (void)w;
    if ((matrix && C < 3) || (decoded && d < 2)) return OUTSIDE;
    for (i64 k = 0; k < r; k++) {
        i64 side = interpolation == CUBIC ? 4 : 2;
        blended(&look, KIND, texels + (gathered ? k * side * side * c : 0), l, gathered, uv + 2 * rows[k], C,
                colour + C * rows[k]);
    }
    return 0;
}
