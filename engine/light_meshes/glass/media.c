/* Finds triangles that are joined by edges (media.py). */
#include <stdlib.h>

#include "../rays/triangles.h"

/* Finds the triangle across each edge; −1 unless exactly two triangles share the edge, in opposite directions.
   order: of the edges (3·triangle + k: from corner k to k + 1), so that equal ones are adjacent. */
KERNEL(media_adjacent, "corner i64[n,3]  order i64[e]  neighbour i32[n,3]!"
       ";  0<=order<3*n")
i64 media_adjacent(i64 n, i64 e, const i64 *corner, const i64 *order, i32 *neighbour) {
    for (i64 k = 0; k < 3 * n; k++) neighbour[k] = -1;
    for (i64 i = 0, j; i < e; i = j) {
        i64 s = order[i], a = corner[s], b = corner[s - s % 3 + (s + 1) % 3];
        for (j = i + 1; j < e; j++) {
            i64 r = order[j], c = corner[r], d = corner[r - r % 3 + (r + 1) % 3];
            if ((a < b ? a : b) != (c < d ? c : d) || (a > b ? a : b) != (c > d ? c : d)) break;
        }
        if (j != i + 2 || corner[order[i + 1]] != b || a == b) continue;
        neighbour[s] = (i32)(order[i + 1] / 3);
        neighbour[order[i + 1]] = (i32)(s / 3);
    }
    return 0;
}

/* Numbers the sets of triangles that are connected by joined edges, in order of appearance. Returns 1 if there is
   not enough memory. */
KERNEL(media_components, "neighbour i32[n,3]  joined bool[n,3]  label i32[n]!"
       ";  -1<=neighbour<n")
i64 media_components(i64 n, const i32 *neighbour, const u8 *joined, i32 *label) {
    i64 *parent = malloc((size_t)(n ? n : 1) * sizeof *parent);
    i32 count = 0;
    if (!parent) return 1;
    for (i64 t = 0; t < n; t++) parent[t] = t;
    for (i64 k = 0; k < 3 * n; k++) {
        if (neighbour[k] < 0 || !joined[k]) continue;
        i64 a = k / 3, b = neighbour[k];
        while (parent[a] != a) parent[a] = parent[parent[a]], a = parent[a];
        while (parent[b] != b) parent[b] = parent[parent[b]], b = parent[b];
        if (a < b) parent[b] = a;
        else parent[a] = b;
    }
    for (i64 t = 0; t < n; t++) {
        i64 a = t;
        while (parent[a] != a) a = parent[a];
        label[t] = a == t ? count++ : label[a];
    }
    free(parent);
    return 0;
}

/* Marks shared edges at both ends of which the two triangles have the same normals, up to the cosine `limit`. */
KERNEL(media_smooth_edges, "corner i64[n,3]  neighbour i32[n,3]  Ns f64[n,3,3]  limit f64  joined bool[n,3]!"
       ";  -1<=neighbour<n")
i64 media_smooth_edges(i64 n, const i64 *corner, const i32 *neighbour, const f64 *Ns, f64 limit, u8 *joined) {
    for (i64 t = 0; t < n; t++)
        for (int k = 0; k < 3; k++) {
            i64 o = neighbour[3 * t + k];
            joined[3 * t + k] = o >= 0;
            for (int end = 0; end < 2 && o >= 0; end++) {
                int i = (k + end) % 3;
                for (int j = 0; j < 3; j++) {
                    if (corner[3 * o + j] != corner[3 * t + i]) continue;
                    const f64 *a = Ns + 9 * t + 3 * i, *b = Ns + 9 * o + 3 * j;
                    if (dot(a, b) < limit * sqrt(dot(a, a) * dot(b, b))) joined[3 * t + k] = 0;
                }
            }
        }
    return 0;
}
