"""What each field of a scene's description may hold: its choices, its smallest and largest value, and a sample of its
type where the default does not show it.

`snapshot.py` checks every value that is read with these tables. A new field that is a number gets its bounds in RANGES;
without an entry there, it may be between -LARGEST and LARGEST.
"""

from __future__ import annotations

import math
from typing import Any

from .description import (
    CAUSTICS,
    FALLOFFS,
    GLASS,
    GLASS_SHADOWS,
    HIGHLIGHTS,
    IMAGE_ALPHAS,
    LIGHT_TYPES,
    MODES,
    REFRACTIONS,
    SHADOWS,
    SOFTNESS,
    STORED_ALPHAS,
    WEIGHTS,
    WORLD_LIGHTS,
    Camera,
    Image,
    Light,
    Material,
    Object,
    Settings,
)
from .programs import PARAMETERS

CHOICES = {
    (Settings, "mode"): MODES,
    (Settings, "shadows"): SHADOWS,
    (Settings, "refraction"): REFRACTIONS,
    (Settings, "world_light"): WORLD_LIGHTS,
    (Settings, "glass"): GLASS,
    (Settings, "glass_shadows"): GLASS_SHADOWS,
    (Settings, "caustics"): CAUSTICS,
    (Settings, "weights"): WEIGHTS,
    (Settings, "mist_falloff"): FALLOFFS,
    (Light, "type"): LIGHT_TYPES,
    (Light, "softness"): SOFTNESS,
    (Material, "highlight"): HIGHLIGHTS,
    (Image, "alpha"): IMAGE_ALPHAS,
    (Image, "stored"): STORED_ALPHAS,
    (Image, "interpolation"): ("LINEAR", "CLOSEST", "CUBIC"),
    (Image, "extension"): ("REPEAT", "EXTEND", "CLIP", "MIRROR"),
}
LARGEST = 1e30  # the largest number that single precision can handle with a safe margin
# The smallest and the largest sensible value; a value outside is an error.
RANGES = {
    (Settings, "h"): (1e-30, 1e30),
    (Settings, "kI"): (0.5, 8.0),
    (Settings, "measured_h"): (0.0, 1e30),
    (Settings, "samples"): (1, 4096),
    (Settings, "max_depth"): (0, 64),
    (Settings, "bounces"): (0, 16),
    (Settings, "reflection_rays"): (1, 1024),
    (Settings, "cutoff"): (0.0, 1.0),
    (Settings, "ambient"): (0.0, 1e6),
    (Settings, "filter_size"): (0.0, 10.0),
    (Settings, "shadow_rate"): (1, 16),
    (Settings, "light_threshold"): (0.0, 1.0),
    (Settings, "light_samples"): (1, 65536),
    (Settings, "seed"): (0, 2**31 - 1),
    (Settings, "mist_start"): (0.0, 1e30),
    (Settings, "mist_depth"): (0.0, 1e30),
    (Settings, "clamp_indirect"): (0.0, 1e30),
    (Camera, "width"): (1, 65536), (Camera, "height"): (1, 65536),
    (Camera, "clip_start"): (-math.inf, math.inf),
    (Camera, "clip_end"): (-math.inf, math.inf),
    (Camera, "lens_radius"): (0.0, 1e30),
    (Camera, "focus_distance"): (1e-30, 1e30),
    (Camera, "lens_blades"): (0, 1000),
    (Camera, "lens_ratio"): (1e-3, 1e3),
    (Light, "radius"): (0.0, 1e30),
    (Light, "soft_radius"): (0.0, 1e30),
    (Light, "reference_distance"): (0.0, 1e30),
    (Light, "shadow_pass"): (-1, 2**32 - 1),
    (Object, "shadow_terminator_geometry_offset"): (0.0, 1e30),
    (Object, "shadow_terminator_normal_offset"): (0.0, 1e30),
    (Object, "shadow_terminator_shading_offset"): (0.0, 1e30),
    (Material, "cryptomatte"): (0, 2**32 - 1),
    (Object, "cryptomatte"): (0, 2**32 - 1),
    (Object, "cryptomatte_asset"): (0, 2**32 - 1),
    (Material, "nShiny"): (0.0, 1e9),
    (Material, "ior"): (0.01, 100.0),
    (Material, "alpha"): (0.0, 1.0),
}
RANGES |= {(Material, name): PARAMETERS[name][1:] for name in (
    "diffuse_roughness", "frosted", "translucent", "roughness", "metal", "F0", "F90", "F82", "dielectric",
    "dielectric_ior", "dielectric_tint", "layered", "compensation", "coat", "coat_roughness", "coat_ior", "coat_tint",
    "sheen", "sheen_roughness", "sheen_tint", "share")}

SAMPLES: dict[tuple[type, str], Any] = {  # an example value for fields without a default, or with default None
    (Camera, "matrix"): None,
    (Camera, "window"): (0.0,) * 4,
    (Camera, "width"): 1,
    (Camera, "height"): 1,
    (Camera, "crop"): (0, 0, 0, 0),
    (Light, "intensity"): (0.0,) * 3,
    (Light, "axes"): ((0.0,) * 3,) * 3,
    (Light, "matrix"): ((0.0,) * 4,) * 3,
}
