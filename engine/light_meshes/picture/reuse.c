/* Finds nodes whose values a change makes invalid (reuse.py). */
#include "../shadows/targets.h"

/* Clears the bits of known for segments from x to places at most `spread` from targets (from a sun's unit vector: the
   segments spread by so much a unit of their way) that may meet a box; all in the frame. */
KERNEL(reuse_forget, "x f64[n,3]  position f64[L,3]  directional bool[L]  spread f64[L]  "
       "boxes f64[b,2,3]  known u64[n,W]!"
       ";  W=words(L)")
i64 reuse_forget(i64 n, i64 L, i64 b, i64 W, const f64 *x, const f64 *position, const u8 *directional,
                 const f64 *spread, const f64 *boxes, u64 *known) {
    Targets targets = {position, directional};
    for (i64 k = 0; k < n; k++)
        for (i64 i = 0; i < L; i++) {
            f64 way[3];
            if (!has(known + k * W, i)) continue;
            way_to(&targets, i, x + 3 * k, way);
            for (i64 box = 0; box < b; box++) {
                f64 near = 0.0, far = directional[i] ? INFINITY : 1.0, wider = spread[i], away = 0.0;
                for (int j = 0; j < 3 && directional[i] && wider > 0.0; j++) {
                    f64 low = boxes[6 * box + j] - x[3 * k + j], high = boxes[6 * box + 3 + j] - x[3 * k + j];
                    away += low * low > high * high ? low * low : high * high;
                }
                if (away > 0.0) wider *= sqrt(away);
                for (int j = 0; j < 3; j++) {
                    f64 low = boxes[6 * box + j] - x[3 * k + j] - wider;
                    f64 high = boxes[6 * box + 3 + j] - x[3 * k + j] + wider;
                    if (way[j] == 0.0) {
                        far = low > 0.0 || high < 0.0 ? -1.0 : far;
                        continue;
                    }
                    f64 a = low / way[j], c = high / way[j];
                    f64 enters = c < a ? c : a, leaves = c > a ? c : a;
                    near = enters > near ? enters : near, far = leaves < far ? leaves : far;
                }
                if (near > far) continue;
                clear_bit(known + k * W, i);
                break;
            }
        }
    return 0;
}
