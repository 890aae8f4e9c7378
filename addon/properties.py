"""What the artist sets: on the scene, on a view layer, on a light, on an object, on a material."""

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty


def _changed(settings, context):
    # Without this Blender hands the old values to the render: an add-on's properties
    # reach evaluated data only when their owner is tagged.
    settings.id_data.update_tag()


def _refraction_changed(settings, context):
    # Written down, so that `caustics` tells this file from one of an earlier release.
    if settings.refraction == 'FULL' and not settings.is_property_set("caustics"):
        settings.caustics = settings.caustics
    _changed(settings, context)


def caustics_of(settings):
    """The scene's caustics: files in which light bends and nothing was chosen are of releases that began with PAPER."""
    if settings.refraction == 'FULL' and not settings.is_property_set("caustics"):
        return 'PAPER'
    return settings.caustics


@persistent
def _show_old_choices(_file):
    for scene in bpy.data.scenes:
        own = scene.light_meshes
        if own.caustics != caustics_of(own):
            own.caustics = caustics_of(own)


def _passes_changed(settings, context):
    # Blender asks for the passes of an engine only when it is told to.
    _changed(settings, context)
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            layer.update_render_passes()


class LightMeshesScene(bpy.types.PropertyGroup):
    mode: EnumProperty(
        name="Method",
        description="How much of the light's way through the scene is followed",
        items=(
            ('LOCAL', "Local", "Light and surface only: no shadows, no reflections. Fastest, for a first look", 0),
            ('RAY_CASTING', "Ray Casting", "With shadows, without reflections", 1),
            ('WHITTED', "Whitted Ray Tracing", "With shadows, and what is seen in mirrors and through glass, as in "
             "T. Whitted's ray tracer of 1980. Surfaces do not light each other", 2),
        ),
        default='WHITTED', update=_changed,
    )
    shadows: EnumProperty(
        name="Shadow Method",
        description="How the edge of a shadow is found",
        items=(
            ('SHARP', "Sharp", "Every shadow has a hard edge", 0),
            ('LIGHT_MESHES', "Light Meshes", "Soft edges without noise: light is looked up at the nodes of a lattice "
             "around each point. Their width is set by the step and the quality below, or by each light", 1),
            ('AREA_SAMPLING', "Area Sampling", "Soft edges from the light's own size, by many shadow rays. "
             "Noisy or slow: a reference to compare with", 2),
        ),
        default='LIGHT_MESHES', update=_changed,
    )
    auto_h: BoolProperty(
        name="Automatic Step",
        description="Take the step of the lattice from what the camera sees at the frame below, "
                    "so that shadow edges look alike at any scale and do not change through an animation",
        default=True, update=_changed,
    )
    measure_frame: IntProperty(
        name="Measured at Frame",
        description="At this frame the automatic step and the sizes of lights are measured, for all frames alike. "
                    "Which frames are rendered does not change it. A file from before this setting has its first frame",
        min=-1048574, max=1048574, default=1, update=_changed,
    )
    h: FloatProperty(
        name="Step (h)",
        description="Distance between the nodes of the lattice. Larger makes shadow edges softer and rendering "
                    "faster; smaller keeps the shadows of small things",
        subtype='DISTANCE', unit='LENGTH', min=1e-6, soft_min=1e-3, soft_max=10.0, default=0.05, precision=4,
        update=_changed,
    )
    kI: FloatProperty(
        name="Quality (kI)",
        description="Radius of the neighbourhood that is averaged, in steps. Larger makes shadow edges wider and "
                    "their gradation finer, and takes longer; below 1.225 some points find no node "
                    "and get sharp shadows",
        min=0.5, max=8.0, soft_min=1.225, soft_max=6.0, default=3.0, update=_changed,
    )
    weights: EnumProperty(
        name="Node Weights",
        description="How the nodes around a point are averaged",
        items=(
            ('UNIFORM', "Uniform", "All count the same: the method as published. With few nodes the gradation of "
             "shadow edges shows fine steps", 0),
            ('SMOOTH', "Smooth", "Nodes count less the farther they are: no steps, and edges that look "
             "a little narrower at the same radius", 1),
        ),
        default='SMOOTH', update=_changed,
    )
    refraction: EnumProperty(
        name="Refraction",
        description="Which rays bend where they enter or leave a closed mesh of glass",
        items=(
            ('NONE', "None", "All rays go straight on, as in OpenGL", 0),
            ('VIEW', "View", "What is seen through glass is bent; shadows fall straight through it", 1),
            ('FULL', "Full", "Shadows too: glass gathers and spreads light as a lens does. Slower", 2),
        ),
        default='VIEW', update=_refraction_changed,
    )
    glass: EnumProperty(
        name="Soft Shadows at Glass",
        description="What a pane of glass does to the soft shadows beside it",
        items=(
            ('BOUNDED', "Bounded", "Glass bounds the neighbourhood that is averaged, as any surface does: "
             "no dark seam beside a pane", 0),
            ('PAPER', "Paper", "The neighbourhood reaches through glass, dimmed by it: the method as published", 1),
        ),
        default='BOUNDED', update=_changed,
    )
    caustics: EnumProperty(
        name="Caustics",
        description="How bright light is that glass has bent",
        items=(
            ('PAPER', "Paper", "Each way through the glass counts with what the glass lets through, as published: "
             "behind a lens there is more light than fell on it", 0),
            ('FOCUS', "Focus", "Ways also count with how closely glass gathers light: a lens makes a bright spot", 1),
        ),
        default='FOCUS', update=_changed,
    )
    leak_free: BoolProperty(
        name="No Leaks",
        description="Keep light that comes through glass from behind a surface off that surface. Slower, takes memory",
        default=False, update=_changed,
    )
    samples: IntProperty(
        name="Samples",
        description="Camera rays per pixel. More make the edges of objects smoother; shadows do not need them",
        min=1, max=4096, soft_max=64, default=4, update=_changed,
    )
    shadow_rate: IntProperty(
        name="Shadow Rate",
        description="Pixels between the points where soft light is computed. What lies between is interpolated where "
                    "they agree, and computed where they do not. 1 computes all; 4 is faster with many lights",
        min=1, max=16, soft_max=8, default=1, update=_changed,
    )
    light_samples: IntProperty(
        name="Shadow Rays",
        description="Shadow rays per light. More make soft shadows less noisy, and take longer",
        min=1, max=65536, soft_max=1024, default=64, update=_changed,
    )
    max_depth: IntProperty(
        name="Reflections",
        description="How often light may be mirrored on its way to the camera. "
                    "With fewer, mirrors seen in mirrors turn black",
        min=0, max=64, soft_max=16, default=4, update=_changed,
    )
    ambient: FloatProperty(
        name="Ambient",
        description="How much the world's color lights every surface, in shadow too. "
                    "0 makes shadows black, 1 is the world's full color",
        min=0.0, max=1e6, soft_max=2.0, default=1.0, update=_changed,
    )


def _pass(name, description):
    return BoolProperty(name=name, description=description, default=False, options=set(), update=_passes_changed)


class LightMeshesViewLayer(bpy.types.PropertyGroup):
    use_pass_ambient: _pass("Ambient", "Deliver the world's light on surfaces, which is there in shadow too")
    use_pass_debug_candidates: _pass(
        "Candidates", "Deliver how many nodes of the lattice were looked at, over all surfaces seen in the pixel")
    use_pass_debug_m: _pass(
        "Nodes (m)", "Deliver how many nodes of the lattice were averaged, over all surfaces seen in the pixel. "
        "Where the visibility of nodes did not matter they are not counted")
    use_pass_debug_empty: _pass(
        "Empty Sets", "Deliver where no node of the lattice was found, so that the shadow is sharp")
    use_pass_debug_skipped: _pass(
        "Skipped", "Deliver where all nodes of the lattice agreed, so that their visibility did not matter")


class LightMeshesLight(bpy.types.PropertyGroup):
    shadow_pass: _pass(
        "Shadow Pass", "Deliver a pass of its own that shows how much of this light reaches each surface: "
        "1 in its full light, 0 in its shadow. Lights that share this data share the pass, as their mean")
    soft_shadows: BoolProperty(
        name="Soft Shadows",
        description="Let the shadows of this light have soft edges; without it they are sharp whatever the scene says",
        default=True, update=_changed,
    )
    softness: EnumProperty(
        name="Softness",
        description="What sets the width of the edges of this light's shadows",
        items=(
            ('SCENE', "Scene", "The scene's step and quality, as for all lights", 0),
            ('RADIUS', "Own Radius", "A radius of this light's own", 1),
            ('LIGHT_SIZE', "Light Size", "The size of the light: edges as wide as a lamp of that size casts them "
             "at one distance", 2),
            ('SIZE', "Size", "The lamp as it is: all of it gives light, a little from each place, so that a large lamp "
             "near a surface is not too bright under its middle, and highlights are as large as the lamp", 3),
        ),
        default='SCENE', update=_changed,
    )
    radius: FloatProperty(
        name="Edge Radius",
        description="Half the width of the edges of this light's shadows. Larger makes them softer, and rendering "
                    "slower where it is many steps (h) long: it may have 16. 0 makes them sharp",
        subtype='DISTANCE', unit='LENGTH', min=0.0, soft_max=10.0, default=0.15, precision=4, update=_changed,
    )
    reference_distance: FloatProperty(
        name="Distance",
        description="How far the shadow falls from what casts it, where the edges shall be as wide as the light's size "
                    "makes them: farther is wider. 0 measures it from what the camera sees",
        subtype='DISTANCE', unit='LENGTH', min=0.0, soft_max=100.0, default=0.0, precision=4, update=_changed,
    )


def _surface_switches(whose: str, other: str) -> dict:
    """The two switches of an object, and of a material."""
    return {
        "cast_soft_shadows": BoolProperty(
            name="Cast Soft Shadows",
            description=f"Let the shadows that {whose} casts have soft edges. Without it they are sharp. "
                        f"They are soft where {other} allows it too",
            default=True, update=_changed),
        "receive_soft_shadows": BoolProperty(
            name="Receive Soft Shadows",
            description=f"Let shadows that fall on {whose} have soft edges. Without it they are sharp. "
                        f"They are soft where {other} allows it too",
            default=True, update=_changed),
    }


class LightMeshesObject(bpy.types.PropertyGroup):
    __annotations__ = _surface_switches("this object", "its material")


def _override_switched(name):
    def update(settings, context):
        # Start from what the picture showed, unless a value was given before.
        if getattr(settings, f"override_{name}") and not settings.is_property_set(name):
            from .export.materials import translated_value

            setattr(settings, name, translated_value(settings.id_data, name))
        _changed(settings, context)
    return update


# The parameters of Whitted's shading that a material's nodes are translated to, and that may be overridden.
PARAMETERS = {
    "ka": FloatProperty(
        name="Ambient", description="How much of the world's color the surface returns, in shadow too",
        min=0.0, soft_max=1.0, default=1.0, update=_changed),
    "kd": FloatProperty(
        name="Diffuse", description="How bright the surface is where light falls on it",
        min=0.0, soft_max=1.0, default=1.0, update=_changed),
    "Od": FloatVectorProperty(
        name="Color", description="Color of the lit and of the ambient surface; replaces an image too",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.8, 0.8, 0.8), update=_changed),
    "ks": FloatProperty(
        name="Highlight", description="How bright the highlights of lights are",
        min=0.0, soft_max=10.0, default=0.0, update=_changed),
    "Os": FloatVectorProperty(
        name="Highlight Color", description="Color of the highlights",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(1.0, 1.0, 1.0), update=_changed),
    "nShiny": FloatProperty(
        name="Shininess", description="How small the highlights are: 1 is a broad sheen, 500 a bright dot",
        min=0.0, max=1e9, soft_min=1.0, soft_max=1000.0, default=50.0, update=_changed),
    "mirror": FloatVectorProperty(
        name="Mirror", description="How much of its surroundings the surface mirrors. Black is no mirror",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.0, 0.0, 0.0), update=_changed),
    "emission": FloatVectorProperty(
        name="Emission", description="Light that the surface shows by itself. It does not light other surfaces",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.0, 0.0, 0.0), update=_changed),
    "kt": FloatVectorProperty(
        name="Transparency", description="How much light passes at each crossing of the surface, and in which color",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.0, 0.0, 0.0), update=_changed),
    "ior": FloatProperty(
        name="IOR", description="How strongly a closed mesh bends rays; 1 does not, glass is 1.5. "
        "An open mesh is a thin sheet and bends nothing",
        min=0.01, max=100.0, soft_min=1.0, soft_max=3.0, default=1.0, update=_changed),
    "fresnel": BoolProperty(
        name="Fresnel", description="Reflect more and let less through the flatter a ray comes in, as real glass does; "
        "without it Mirror and Transparency are the same from all sides",
        default=False, update=_changed),
    "alpha": FloatProperty(
        name="Alpha", description="How much of the surface is there: 0 is a hole", min=0.0, max=1.0, default=1.0,
        update=_changed),
}


PRIORITY = IntProperty(
    name="Priority", description="Where closed meshes of glass overlap, the one with the highest priority is there: "
    "give the glass more than the water in it", min=0, max=100, default=0, update=_changed)


class LightMeshesMaterial(bpy.types.PropertyGroup):
    __annotations__ = PARAMETERS | {"priority": PRIORITY} | _surface_switches("this material", "the object") | {
        f"override_{name}": BoolProperty(
            name=f"Override {parameter.keywords['name']}", default=False, update=_override_switched(name),
            description="Use the value here instead of the one translated from the nodes")
        for name, parameter in PARAMETERS.items()
    }


translated: dict[int, dict] = {}  # what the panel of the material with this session_uid found


def _translated(name):
    """What shows a color as it is: Blender dims those that cannot be changed. To change it is to override it."""
    def override(own, value):
        settings = own.id_data.light_meshes
        setattr(settings, name, value)
        setattr(settings, f"override_{name}", True)
    return {"get": lambda own: translated[own.id_data.session_uid][name], "set": override}


class LightMeshesTranslated(bpy.types.PropertyGroup):
    """The colors that a material's nodes are translated to, for the panel to show."""

    __annotations__ = {
        name: FloatVectorProperty(
            name=parameter.keywords["name"], description="As translated from the nodes; another color overrides it",
            subtype='COLOR', size=3, **_translated(name))
        for name, parameter in PARAMETERS.items() if parameter.keywords.get("subtype") == 'COLOR'
    }


_GROUPS = {
    bpy.types.Scene: LightMeshesScene,
    bpy.types.ViewLayer: LightMeshesViewLayer,
    bpy.types.Light: LightMeshesLight,
    bpy.types.Object: LightMeshesObject,
    bpy.types.Material: LightMeshesMaterial,
}


def register() -> None:
    for owner, group in _GROUPS.items():
        bpy.utils.register_class(group)
        owner.light_meshes = PointerProperty(type=group)
    bpy.utils.register_class(LightMeshesTranslated)
    bpy.types.Material.light_meshes_translated = PointerProperty(type=LightMeshesTranslated)
    bpy.app.handlers.load_post.append(_show_old_choices)


def unregister() -> None:
    bpy.app.handlers.load_post.remove(_show_old_choices)
    del bpy.types.Material.light_meshes_translated
    bpy.utils.unregister_class(LightMeshesTranslated)
    for owner, group in _GROUPS.items():
        del owner.light_meshes
        bpy.utils.unregister_class(group)
