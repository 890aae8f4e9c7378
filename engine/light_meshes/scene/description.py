"""The description of a scene: immutable dataclasses, with units and shapes.

Lengths are in scene units (metres in an untouched Blender file), colours are scene-linear RGB, matrices act on column
vectors, angles are in radians. This module does not use Blender, files or Embree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support.text import quoted
from . import transforms
from .errors import SceneError
from .geometry import Geometry
from .material import DEFAULT_MATERIAL
from .material import HIGHLIGHTS as HIGHLIGHTS
from .material import RGB as RGB
from .material import Material as Material
from .mesh import Mesh, at_least, numbers
from .profile import Profile
from .programs import NO_PROGRAM, Program

MODES = ("LOCAL", "RAY_CASTING", "WHITTED")
REFRACTIONS = ("NONE", "VIEW", "FULL")
WORLD_LIGHTS = ("AMBIENT", "SKY")
GLASS = ("BOUNDED", "PAPER")
GLASS_SHADOWS = ("CLEAR", "SOLID")
CAUSTICS = ("PAPER", "FOCUS")
SHADOWS = ("SHARP", "LIGHT_MESHES", "AREA_SAMPLING")  # the methods of `shadows.registry`
LIGHT_TYPES = ("POINT", "SUN", "SPOT", "AREA")
FALLOFFS = ("LINEAR", "QUADRATIC", "INVERSE_QUADRATIC")
WEIGHTS = ("UNIFORM", "SMOOTH")
SOFTNESS = ("SCENE", "RADIUS", "LIGHT_SIZE", "SIZE")
COLORSPACES = ("sRGB", "LINEAR")  # and those of an OpenColorIO configuration
IMAGE_ALPHAS = ("KEEP", "MULTIPLIED", "STRAIGHT", "IGNORED")
STORED_ALPHAS = ("FILE", "MULTIPLIED", "STRAIGHT")
Scalar = bool | int | float | str
Row = tuple[float, float, float, float]
IDENTITY: tuple[RGB, RGB, RGB] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Settings:
    """What to compute. Names are the paper's symbols where it has them."""

    mode: str = "WHITTED"  # eq. (1) RAY_CASTING, eq. (2) WHITTED, or LOCAL without shadows
    shadows: str = "LIGHT_MESHES"
    h: float = 0.05  # step of the lattice, scene units
    kI: float = 3.0  # r = h·kI is the radius of the interpolation ball
    auto_h: bool = False  # choose h from what the camera sees, finer if a light's r needs it; `h` is then ignored
    measured_h: float = 0.0  # for auto_h: the h that the camera measured before; 0 means measure it now
    weights: str = "UNIFORM"  # weights of the nodes in the ball: UNIFORM (paper), or SMOOTH, falling to 0 at r
    samples: int = 4  # camera rays per pixel
    max_depth: int = 4  # how many mirror reflections follow the first hit
    fast_reflections: bool = False  # rough surfaces show matt ones by the light of patches that is gathered
    reflection_rays: int = 128  # about so many rays of a pixel follow a wide rough reflection, or go into rough glass
    clamp_indirect: float = 0.0  # light that mirrors and glass show is at most so bright, as Cycles has it; 0: no limit
    cutoff: float = 1e-3  # a reflected ray that can add less than this share of its light is not traced
    ambient: float = 1.0  # factor on Ia = world colour
    world_light: str = "AMBIENT"  # how the world lights: AMBIENT, the paper's Ia·ka, or SKY, from all around
    bounces: int = 0  # how often diffuse light goes on from surface to surface
    filter_size: float = 1.5  # size of the Blackman-Harris pixel filter: it ends this many pixels from the centre
    share_samples: bool = False  # pixels take the samples of those around, too, weighted by the filter
    refraction: str = "VIEW"  # which rays glass bends: M1 NONE, M2 VIEW rays, M3 FULL: shadow paths too (eq. 6)
    glass: str = "BOUNDED"  # nodes behind glass: BOUNDED drops them, PAPER weights them as in eq. (7)
    caustics: str = "PAPER"  # energy of refracted paths: Σ Π t, or FOCUS: Σ Π t·J
    # what stands in the light's way with VIEW: CLEAR, light goes straight on; SOLID, what glass turns aside is missing
    glass_shadows: str = "CLEAR"
    leak_free: bool = False  # end of paper §5: use ξ of the first segment for each path
    shadow_rate: int = 1  # soft light is computed at points this many pixels apart, and interpolated; 1: at each sample
    # with LIGHT_MESHES: lamps that together give at most this share of a place's light share a shadow there; 0: none
    light_threshold: float = 0.0
    light_samples: int = 64  # shadow rays per light, only for AREA_SAMPLING
    seed: int = 0  # for AREA_SAMPLING
    method: Mapping[str, Scalar] | None = None  # settings that the shadow method has for itself; None: its defaults
    mist_start: float = 0.0  # for the pass Mist: the distance at which it is 0, in scene units
    mist_depth: float = 100.0  # how much farther away it is 1
    mist_falloff: str = "LINEAR"  # how it rises: LINEAR, QUADRATIC, INVERSE_QUADRATIC
    film_transparent: bool = False  # alpha 0 where nothing is hit
    lattice_rotation: bool = True  # False: nodes are at multiples of h (for tests; artists' walls are often there)
    lattice_origin: RGB = (0.0, 0.0, 0.0)
    uniform_skip: bool = True  # exact shortcut of method §5; switch it off only to measure or test it

    @property
    def gathers(self) -> bool:
        """Return whether light comes from everywhere: from the world with occlusion, or from surface to surface."""
        return (self.world_light == "SKY" or self.bounces > 0) and self.mode != "LOCAL"

    @property
    def by_sky(self) -> bool:
        """Return whether the world lights with occlusion and direction, and not as ambient light."""
        return self.gathers and self.world_light == "SKY"


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

    @classmethod
    def look_at(cls, eye: Sequence[float], target: Sequence[float], degrees: float, width: int, height: int,
                up: Sequence[float] = (0.0, 0.0, 1.0), **more: Any) -> Camera:
        """Return a perspective camera at `eye` that looks at `target`, for a picture of width × height pixels.

        degrees: the field of view along the longer side, as in Blender. `more`: fields of Camera, by their names.
        Raises SceneError if these numbers describe no view.
        """
        angle = float(numbers(degrees, "camera: the field of view", ()))
        if not 0 < angle < 180:
            raise SceneError(f"camera: the field of view is {angle:g} degrees; it must lie between 0 and 180")
        _check_pixels(width, height)
        half = float(np.tan(np.radians(angle) / 2)) / max(width, height)
        window = (-half * width, half * width, -half * height, half * height)
        return cls(transforms.look_at(eye, target, up), window, width, height, **more)

    @classmethod
    def orthographic(cls, eye: Sequence[float], target: Sequence[float], size: float, width: int, height: int,
                     up: Sequence[float] = (0.0, 0.0, 1.0), **more: Any) -> Camera:
        """Return a camera of parallel rays, at `eye` and looking at `target`, that sees `size` scene units.

        size is that of the longer side, as in Blender; `more` are fields of Camera, by their names. Raises SceneError.
        """
        half = float(numbers(size, "camera: its size", ())) / 2
        _check_pixels(width, height)
        x, y = half * (width / max(width, height)), half * (height / max(width, height))
        return cls(transforms.look_at(eye, target, up), (-x, x, -y, y), width, height, perspective=False, **more)


def _check_pixels(width: int, height: int) -> None:
    """Raise SceneError unless these are the width and height of a picture, in pixels."""
    at_least(1, width, "camera: its width in pixels")
    at_least(1, height, "camera: its height in pixels")


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
    radius: float = 0.0  # for AREA_SAMPLING, LIGHT_SIZE and SIZE: radius of the sphere (POINT, SPOT), scene units
    angle: float = 0.0  # for the same: full apparent angle of a SUN
    area_u: RGB = (0.0, 0.0, 0.0)  # for the same: half-axes of the rectangle or ellipse
    area_v: RGB = (0.0, 0.0, 0.0)
    area_ellipse: bool = False
    facing_disc: bool = False  # POINT and SPOT with SIZE: lights as a disc that turns to each receiver, not a sphere
    # With SIZE, which rays see the lamp itself:
    seen_by_camera: bool = False
    seen_in_mirrors: bool = False
    seen_in_glass: bool = False
    soft_shadows: bool = True  # False: sharp even under LIGHT_MESHES and AREA_SAMPLING
    cast_shadow: bool = True  # False: shines through everything
    # Whose soft shadow it casts. One of the same width everywhere, r: SCENE h·kI, RADIUS soft_radius, LIGHT_SIZE
    # 1.12·ρ·a/(L − a) (method §2). Or SIZE: that of the lamp's own sphere, disc of the sky, rectangle or ellipse, and
    # all of it lights surfaces; lamps of the others light as points.
    softness: str = "SCENE"
    soft_radius: float = 0.0  # for RADIUS: r, scene units
    # for LIGHT_SIZE: a, the distance from the caster of a shadow to its receiver; 0: measure it
    reference_distance: float = 0.0
    receivers: tuple[int, ...] | None = None  # objects that it lights; None: all
    blockers: tuple[int, ...] | None = None  # objects that cast shadows in its light; None: all
    shadow_pass: int = -1  # the pass "Shadow N" shows the visibility of the lights that have this N; -1: no pass
    program: Program = NO_PROGRAM  # its nodes: by what `intensity` is multiplied for a point that it lights
    # From the lamp's own space, in which programs see it, to the world; None: x, y and z are those of the world.
    matrix: tuple[Row, Row, Row] | None = None


@dataclass(frozen=True)
class Image:
    """A texture on disk. Relative paths are relative to the snapshot's folder."""

    name: str
    path: str
    colorspace: str = "sRGB"  # sRGB | LINEAR | a space of the OpenColorIO configuration `ocio`
    interpolation: str = "LINEAR"  # LINEAR | CLOSEST | CUBIC
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
    visible_diffuse: bool = True  # met by rays that gather light from everywhere (Settings.world_light, bounces)
    # where its surfaces give light and become lamps: objects that these light, and that block them; None: all
    receivers: tuple[int, ...] | None = None
    blockers: tuple[int, ...] | None = None
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
    # Generated coordinates go from 0 to 1 over a box in the object's own space: its centre, and half of its size.
    texture_location: RGB = (0.0, 0.0, 0.0)
    texture_size: RGB = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh of one material that stands in one place or in several: what `Scene.from_shapes` takes.

    Shapes that share a Mesh share its triangles in memory.
    """

    mesh: Mesh
    material: Material = DEFAULT_MATERIAL
    name: str = "object"
    # (4,4) local to world, one for each place; `transforms` makes them.
    matrices: Sequence[ArrayLike] = field(default_factory=lambda: (np.eye(4),))
    flags: Mapping[str, Any] = field(default_factory=dict)  # fields of Object, by their names


@dataclass(frozen=True)
class Scene:
    """Everything that a picture depends on."""

    camera: Camera
    geometry: Geometry
    lights: tuple[Light, ...] = ()
    materials: tuple[Material, ...] = (Material("default"),)
    images: tuple[Image, ...] = ()
    profiles: tuple[Profile, ...] = ()  # of IES files
    objects: tuple[Object, ...] = ()
    world_color: RGB = (0.0, 0.0, 0.0)  # radiance, for background and ambient light Ia
    # What the world is by direction, where it is not `world_color` in all: it sets "emission", the radiance that comes
    # from where "position" is, a unit vector. `world_color` has then no meaning.
    world: Program = NO_PROGRAM
    settings: Settings = field(default_factory=Settings)
    to_rec709: tuple[RGB, RGB, RGB] = IDENTITY  # from the scene's linear light to that of sRGB, which PNGs use
    warnings: tuple[str, ...] = ()  # one sentence for each thing that the exporter could not translate

    @classmethod
    def from_shapes(cls, shapes: Sequence[Shape], camera: Camera, lights: Sequence[Light] = (),
                    settings: Settings | None = None, **more: Any) -> Scene:
        """Return a scene of these shapes, each an object of its name; `more` are fields of Scene, by their names.

        Materials and meshes that shapes share are there once. Raises SceneError where a shape is none.
        """
        materials: dict[Material, int] = {}
        meshes: dict[tuple[int, int], int] = {}  # a mesh with a material, which belongs to its triangles
        of_meshes: list[Mesh] = []
        instances = []
        for n, shape in enumerate(shapes):
            _check_shape(shape, n)
            material = materials.setdefault(shape.material, len(materials))
            mesh = meshes.setdefault((id(shape.mesh), material), len(meshes))
            of_meshes += [shape.mesh] * (mesh == len(of_meshes))
            instances += [(mesh, n, matrix) for matrix in shape.matrices]
        geometry = Geometry.from_meshes(of_meshes, [material for _, material in meshes], instances)
        return cls(camera, geometry, tuple(lights), tuple(materials) or (Material("default"),),
                   objects=tuple(Object(s.name, **s.flags) for s in shapes), settings=settings or Settings(), **more)

    def with_settings(self, **changes: Any) -> Scene:
        """Return the scene with some settings changed, by their names. Raises SceneError for an unknown name."""
        unknown = changes.keys() - names_of(Settings)
        if unknown:
            raise SceneError(f"there is no setting {quoted(min(unknown))}; there are {', '.join(names_of(Settings))}")
        return replace(self, settings=replace(self.settings, **changes))


def _check_shape(shape: Shape, n: int) -> None:
    """Raise SceneError unless what `shape` holds is what it should be."""
    if not isinstance(shape, Shape):
        raise SceneError(f"shape {n} is of type {type(shape).__name__}; a Shape holds a mesh, its material and "
                         "its places")
    where = f"shape {n} {quoted(shape.name)}"
    for name, kind in (("mesh", Mesh), ("material", Material)):
        if not isinstance(getattr(shape, name), kind):
            raise SceneError(f"{where}: its {name} is of type {type(getattr(shape, name)).__name__}; it must "
                             f"be of type {kind.__name__}")
    try:
        hash(shape.material)
    except TypeError:
        raise SceneError(f"{where}: colours of its material must be tuples of 3 numbers, no lists or arrays") from None
    unknown = shape.flags.keys() - names_of(Object)
    if unknown:
        raise SceneError(f"{where}: an object has no {quoted(min(unknown))}; it has {', '.join(names_of(Object))}")


@cache
def names_of(cls: type) -> dict[str, Any]:
    """Return field name → default of a description class, in order."""
    return {f.name: f.default for f in fields(cls)}


def same(a: Any, b: Any) -> bool:
    """Return whether two descriptions have the same contents."""
    if a is b:
        return True
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b)
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)
