"""The description of a scene: immutable dataclasses, with units and shapes.

Lengths are in scene units (metres in an untouched Blender file), colours are scene-linear RGB, matrices act on column
vectors, angles are in radians. This module does not use Blender, files or Embree.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

MODES = ("LOCAL", "RAY_CASTING", "WHITTED")
REFRACTIONS = ("NONE", "VIEW", "FULL")
GLASS = ("BOUNDED", "PAPER")
CAUSTICS = ("PAPER", "FOCUS")
SHADOWS = ("SHARP", "LIGHT_MESHES", "AREA_SAMPLING")
LIGHT_TYPES = ("POINT", "SUN", "SPOT", "AREA")
FALLOFFS = ("LINEAR", "QUADRATIC", "INVERSE_QUADRATIC")
WEIGHTS = ("UNIFORM", "SMOOTH")
SOFTNESS = ("SCENE", "RADIUS", "LIGHT_SIZE")
COLORSPACES = ("sRGB", "LINEAR")  # and those of an OpenColorIO configuration
IMAGE_ALPHAS = ("KEEP", "MULTIPLIED", "STRAIGHT", "IGNORED")
STORED_ALPHAS = ("FILE", "MULTIPLIED", "STRAIGHT")
RGB = tuple[float, float, float]
IDENTITY: tuple[RGB, RGB, RGB] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Settings:
    """What to compute. Names are the paper's symbols where it has them."""

    mode: str = "WHITTED"  # eq. (1) RAY_CASTING, eq. (2) WHITTED, or LOCAL without shadows
    shadows: str = "LIGHT_MESHES"
    h: float = 0.05  # step of the lattice, scene units
    kI: float = 3.0  # r = h·kI is the radius of the interpolation ball
    auto_h: bool = False  # choose h from what the camera sees, finer if a light's r needs it; `h` is then ignored
    # for auto_h: the h that was measured before from what the camera sees; 0 means measure it now
    measured_h: float = 0.0
    weights: str = "UNIFORM"  # weights of the nodes in the ball: UNIFORM (paper), or SMOOTH, falling to 0 at r
    samples: int = 4  # camera rays per pixel
    max_depth: int = 4  # how many mirror reflections follow the first hit
    cutoff: float = 1e-3  # a reflected ray that can add less than this share of its light is not traced
    ambient: float = 1.0  # factor on Ia = world colour
    filter_size: float = 1.5  # size of the Blackman-Harris pixel filter: it ends this many pixels from the centre
    refraction: str = "VIEW"  # which rays glass bends: M1 NONE, M2 VIEW rays, M3 FULL: shadow paths too (eq. 6)
    glass: str = "BOUNDED"  # nodes behind glass: BOUNDED drops them, PAPER weights them as in eq. (7)
    caustics: str = "PAPER"  # energy of refracted paths: Σ Π t, or FOCUS: Σ Π t·J
    leak_free: bool = False  # end of paper §5: use ξ of the first segment for each path
    # compute light meshes' light only at points this many pixels apart and interpolate; 1: at each sample
    shadow_rate: int = 1
    light_samples: int = 64  # shadow rays per light, only for AREA_SAMPLING
    seed: int = 0  # for AREA_SAMPLING
    mist_start: float = 0.0  # for the pass Mist: the distance at which it is 0, in scene units
    mist_depth: float = 100.0  # how much farther away it is 1
    mist_falloff: str = "LINEAR"  # how it rises: LINEAR, QUADRATIC, INVERSE_QUADRATIC
    film_transparent: bool = False  # alpha 0 where nothing is hit
    lattice_rotation: bool = True  # False: nodes are at multiples of h (for tests; artists' walls are often there)
    lattice_origin: RGB = (0.0, 0.0, 0.0)
    uniform_skip: bool = True  # exact shortcut of method §5; switch it off only to measure or test it


@dataclass(frozen=True)
class Camera:
    """A perspective or orthographic camera. It looks along its local −z, with y up, as in Blender and OpenGL."""

    matrix: NDArray[np.float64]  # (4,4) camera to world, rigid
    window: tuple[float, float, float, float]  # left, right, bottom, top of the whole frame,
    #                                            at distance 1, or in scene units where orthographic
    width: int  # of the whole frame, pixels
    height: int
    perspective: bool = True
    clip_start: float = 1e-3  # smallest depth along −z
    clip_end: float = 1e30
    lens_radius: float = 0.0  # in scene units; 0 is a pinhole, everything is in focus
    focus_distance: float = 1.0  # the depth that is in focus
    lens_blades: int = 0  # corners of the lens; with less than 3 it is round
    lens_rotation: float = 0.0  # angle of the middle of a blade, counter-clockwise from x
    lens_ratio: float = 1.0  # above 1 the lens is narrower along x, like anamorphic ones
    crop: tuple[int, int, int, int] | None = None  # x0, y0, x1, y1 in pixels, y up, ends excluded; None: everything


@dataclass(frozen=True)
class Light:
    """A point source (or a direction). Shadows and AREA_SAMPLING also use its size."""

    name: str
    type: str
    intensity: RGB  # I_i: kd·Od·I·cos·f_att is the radiance that a diffuse surface returns (so 1/π is in it);
    #                 f_att = 1/d² but for SUN, where it is 1. AREA: on its axis, with a further cosine.
    position: RGB = (0.0, 0.0, 0.0)  # ignored for SUN
    # unit; the direction in which the light travels: SUN, axis of a SPOT, normal of an AREA
    direction: RGB = (0.0, 0.0, -1.0)
    spot_angle: float = np.pi / 4  # full cone
    spot_blend: float = 0.0  # 0 hard edge .. 1
    spread: float = np.pi  # AREA: the full angle of its cone of light
    # Axes of a lamp that is scaled unevenly or sheared, otherwise None. Along the direction ω such a lamp sends the
    # same light as a regular lamp that looks along the third of its own axes sends along (ω·a₁, ω·a₂, ω·a₃). This holds
    # for SPOT; for AREA it is as in Cycles (see `shading`).
    axes: tuple[RGB, RGB, RGB] | None = None
    diffuse: bool = True  # whether it lights matt surfaces
    glossy: bool = True  # whether it gives highlights
    radius: float = 0.0  # for AREA_SAMPLING and LIGHT_SIZE: radius of the sphere (POINT, SPOT), scene units
    angle: float = 0.0  # for the same: full apparent angle of a SUN
    area_u: RGB = (0.0, 0.0, 0.0)  # for the same: half-axes of the rectangle or ellipse
    area_v: RGB = (0.0, 0.0, 0.0)
    area_ellipse: bool = False
    soft_shadows: bool = True  # False: sharp even under LIGHT_MESHES and AREA_SAMPLING
    cast_shadow: bool = True  # False: shines through everything
    softness: str = "SCENE"  # how r is set: SCENE h·kI, RADIUS soft_radius, LIGHT_SIZE 1.12·ρ·a/(L − a) (method §2)
    soft_radius: float = 0.0  # for RADIUS: r, scene units
    # for LIGHT_SIZE: a, the distance from the caster of a shadow to its receiver; 0: measure it
    reference_distance: float = 0.0
    receivers: tuple[int, ...] | None = None  # objects that it lights; None: all
    blockers: tuple[int, ...] | None = None  # objects that cast shadows in its light; None: all
    shadow_pass: int = -1  # the pass "Shadow N" shows the visibility of the lights that have this N; -1: no pass


@dataclass(frozen=True)
class Material:
    """Whitted's parameters (method §1): Ω = f_att·I·[kd·Od·(N·L) + ks·Os·(R·V)^nShiny]."""

    name: str
    Od: RGB = (0.8, 0.8, 0.8)
    ka: float = 1.0
    kd: float = 1.0
    ks: float = 0.0
    Os: RGB = (1.0, 1.0, 1.0)
    nShiny: float = 50.0
    mirror: RGB = (0.0, 0.0, 0.0)  # ks of the recursive term, coloured; 0 for a surface with only highlights
    emission: RGB = (0.0, 0.0, 0.0)  # radiance
    kt: RGB = (0.0, 0.0, 0.0)  # kt·Ot: the factor for light at each crossing
    ior: float = 1.0  # acts only at closed meshes; an open sheet does not bend rays
    priority: int = 0  # where media overlap, the one with the highest priority counts
    fresnel: bool = False  # compute mirror and kt from Fresnel's equations
    alpha: float = 1.0  # the share of the surface that is there; the rest is a hole that neither bends nor shades
    alpha_image: int = -1  # index of the image whose alpha channel multiplies alpha; -1: none
    transparent_shadow: bool = True  # False: casts the shadow of an opaque surface
    image: int = -1  # index of the image that replaces Od; -1: none
    cast_soft_shadows: bool = True  # False: the shadows that it casts are sharp (method §4b)
    receive_soft_shadows: bool = True  # False: the shadows that fall on it are sharp (method §4c)
    index: int = 0  # the artist's number for the Material Index pass
    cryptomatte: int = 0  # the number of its name for Cryptomatte


@dataclass(frozen=True)
class Image:
    """A texture on disk. Relative paths are relative to the snapshot's folder."""

    name: str
    path: str
    colorspace: str = "sRGB"  # sRGB | LINEAR | a space of the OpenColorIO configuration `ocio`
    interpolation: str = "LINEAR"  # LINEAR | CLOSEST
    extension: str = "REPEAT"  # REPEAT | EXTEND | CLIP | MIRROR
    matrix: tuple[RGB, RGB, RGB] = IDENTITY  # from the linear light of sRGB or LINEAR to the scene's
    ocio: str = ""  # the file of the configuration
    working_space: str = "scene_linear"  # the name of the scene's linear light in `ocio`
    alpha: str = "KEEP"  # KEEP: colours as in the file; MULTIPLIED or STRAIGHT: by alpha; IGNORED: alpha is 1
    stored: str = "FILE"  # how the file stores colours: as it says itself (FILE), or MULTIPLIED or STRAIGHT


@dataclass(frozen=True)
class Object:
    """An object as the artist sees it; it may have several instances."""

    name: str
    visible_camera: bool = True
    visible_reflection: bool = True  # seen in mirrors
    visible_shadow: bool = True  # casts shadows
    # False: the shadows that it casts are sharp; the object and the material must both allow soft ones
    cast_soft_shadows: bool = True
    receive_soft_shadows: bool = True  # False: the shadows that fall on it are sharp
    holdout: bool = False  # a hole in the picture: black, alpha 0
    shadow_catcher: bool = False  # the camera sees only the shadows on it
    # For smooth surfaces, with the names of Cycles and Blender (see `terminator`): the cosine to a light below which
    # shadow rays start above the facets (0: never); an additional height for this; and the share by which the edge of
    # the light is moved towards the light.
    shadow_terminator_geometry_offset: float = 0.0
    shadow_terminator_normal_offset: float = 0.0
    shadow_terminator_shading_offset: float = 0.0
    index: int = 0  # the artist's number for the Object Index pass
    cryptomatte: int = 0  # the number of its name for Cryptomatte
    cryptomatte_asset: int = 0  # and the number for its topmost parent


@dataclass(frozen=True)
class Geometry:
    """All meshes in one set of arrays, and their instances.

    Mesh m has vertices[v0 : v0+nv] and triangles[t0 : t0+nt], with (v0, nv, t0, nt) = meshes[m].
    """

    vertices: NDArray[np.float32]  # (V,3) local
    triangles: NDArray[np.int32]  # (T,3) indices from 0 within the mesh, counter-clockwise from outside
    corner_normals: NDArray[np.float32]  # (T,3,3) local, unit; the shading normals
    uvs: NDArray[np.float32]  # (T,3,2), or (0,3,2) where no material has an image
    triangle_materials: NDArray[np.int32]  # (T,) index into Scene.materials
    meshes: NDArray[np.int64]  # (M,4) v0, nv, t0, nt
    instance_mesh: NDArray[np.int32]  # (I,)
    instance_object: NDArray[np.int32]  # (I,) index into Scene.objects
    instance_matrix: NDArray[np.float64]  # (I,4,4) local to world


@dataclass(frozen=True)
class Scene:
    """Everything that a picture depends on."""

    camera: Camera
    geometry: Geometry
    lights: tuple[Light, ...] = ()
    materials: tuple[Material, ...] = (Material("default"),)
    images: tuple[Image, ...] = ()
    objects: tuple[Object, ...] = ()
    world_color: RGB = (0.0, 0.0, 0.0)  # radiance, for background and ambient light Ia
    settings: Settings = field(default_factory=Settings)
    to_rec709: tuple[RGB, RGB, RGB] = IDENTITY  # from the scene's linear light to that of sRGB, which PNGs use
    warnings: tuple[str, ...] = ()  # one sentence for each thing that the exporter could not translate


def names_of(cls: type) -> dict[str, Any]:
    """Return field name → default of a description class, in order."""
    return {f.name: f.default for f in fields(cls)}
