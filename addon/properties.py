"""The properties that the artist sets: on the scene, on a view layer and on a light.

Those of objects and materials are in `surface_properties.py`; all are registered here.
"""

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty

from .surface_properties import LightMeshesMaterial, LightMeshesObject, LightMeshesTranslated
from .surface_properties import changed as _changed


def _refraction_changed(settings, context):
    # Store the value, so that `caustics_of` can tell this file from a file of an earlier release.
    if settings.refraction == 'FULL' and not settings.is_property_set("caustics"):
        settings.caustics = settings.caustics
    _changed(settings, context)


def caustics_of(settings):
    """Return the scene's caustics setting. Files with bent light in which nothing was chosen come from early releases,
    which had only PAPER.
    """
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
    # Blender asks an engine for its passes only when it is told to do so.
    _changed(settings, context)
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            layer.update_render_passes()


class LightMeshesScene(bpy.types.PropertyGroup):
    mode: EnumProperty(
        name="Method",
        description="Which shadows, reflections and refractions are computed",
        items=(
            ('LOCAL', "Local", "Light and surface only: no shadows, no reflections. Fastest, for a first look", 0),
            ('RAY_CASTING', "Ray Casting", "With shadows, without reflections", 1),
            ('WHITTED', "Whitted Ray Tracing", "With shadows, mirrors and refraction through glass, as in "
             "T. Whitted's ray tracer of 1980", 2),
        ),
        default='WHITTED', update=_changed,
    )
    shadows: EnumProperty(
        name="Shadow Method",
        description="How the edges of shadows are computed",
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
        description="The automatic step and the radii from lights' sizes are measured at this frame and used for all "
                    "frames, whichever are rendered. In files saved before this setting existed it is the first frame",
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
            ('UNIFORM', "Uniform", "All nodes have the same weight: the method as published. With few nodes the "
             "gradation of shadow edges shows fine steps", 0),
            ('SMOOTH', "Smooth", "Nodes have less weight the farther away they are: there are no steps, and edges "
             "look a little narrower at the same radius", 1),
        ),
        default='SMOOTH', update=_changed,
    )
    refraction: EnumProperty(
        name="Refraction",
        description="Which rays bend where they enter or leave a closed mesh of glass",
        items=(
            ('NONE', "None", "All rays go straight on, as in OpenGL", 0),
            ('VIEW', "View", "Rays from the camera bend; light goes straight through glass", 1),
            ('FULL', "Full", "Light bends too: glass gathers and spreads it as a lens does. Slower", 2),
        ),
        default='VIEW', update=_refraction_changed,
    )
    glass_shadows: EnumProperty(
        name="Shadows of Glass",
        description="What becomes of light that goes straight on where glass would bend it",
        items=(
            ('CLEAR', "Clear", "It passes: balls and lenses have faint shadows", 0),
            ('SOLID', "Solid", "It passes where the glass hardly turns it aside: panes and thin walls let it through, "
             "balls and lenses have dark shadows", 1),
        ),
        default='SOLID', update=_changed,
    )
    glass: EnumProperty(
        name="Soft Shadows at Glass",
        description="What a pane of glass does to the soft shadows beside it",
        items=(
            ('BOUNDED', "Bounded", "The neighbourhood that is averaged ends at glass, as at any surface: "
             "there is no dark seam beside a pane", 0),
            ('PAPER', "Paper", "The neighbourhood goes on behind glass, where it counts less by the glass's "
             "transparency: the method as published", 1),
        ),
        default='BOUNDED', update=_changed,
    )
    caustics: EnumProperty(
        name="Caustics",
        description="How the brightness of light that glass has bent is computed",
        items=(
            ('PAPER', "Paper", "Each light path is multiplied only by the transparency of the glass, as published: "
             "behind a lens there is more light than fell on it", 0),
            ('FOCUS', "Focus", "Each path is also multiplied by how much the glass concentrates the light: "
             "a lens makes a bright spot", 1),
        ),
        default='FOCUS', update=_changed,
    )
    leak_free: BoolProperty(
        name="No Leaks",
        description="A surface gets no light that comes through glass from behind it. Slower, and needs memory",
        default=False, update=_changed,
    )
    samples: IntProperty(
        name="Samples",
        description="Camera rays per pixel. More make the edges of objects smoother; shadows do not need them",
        min=1, max=4096, soft_max=64, default=4, update=_changed,
    )
    shadow_rate: IntProperty(
        name="Shadow Rate",
        description="How many pixels apart soft light is computed. Between these points it is interpolated where they "
                    "agree, and computed where they do not. 1 computes it everywhere; 4 is faster with many lights",
        min=1, max=16, soft_max=8, default=1, update=_changed,
    )
    light_threshold: FloatProperty(
        name="Light Threshold",
        description="Lamps that together give at most this share of the light somewhere have one shadow there. "
                    "0 lets each have its own; .01 is faster with hundreds of lamps",
        min=0.0, max=1.0, soft_max=0.1, default=0.0, precision=3, update=_changed,
    )
    light_samples: IntProperty(
        name="Shadow Rays",
        description="Shadow rays per light. More make soft shadows less noisy, and take longer",
        min=1, max=65536, soft_max=1024, default=64, update=_changed,
    )
    max_depth: IntProperty(
        name="Reflections",
        description="How often light may be mirrored on its way to the camera: after that, mirrors are black",
        min=0, max=64, soft_max=16, default=4, update=_changed,
    )
    fast_reflections: BoolProperty(
        name="Fast Rough Reflections",
        description="Rough surfaces show matt ones as these light others, with highlights spread out",
        default=True, update=_changed,
    )
    share_samples: BoolProperty(
        name="Share Samples",
        description="Pixels take the samples of those around, too, weighted by the pixel filter: edges are as smooth "
                    "as with twice as many samples, in the same time. Not with one sample, nor where the filter is "
                    "smaller than 1 pixel or larger than 2.5",
        default=True, update=_changed,
    )
    clamp_indirect: FloatProperty(
        name="Clamp Indirect",
        description="Light that mirrors, rough surfaces and glass show is at most so bright, but for lamps and other "
                    "things that give light in the first smooth one. 0: no limit",
        min=0.0, max=1e8, soft_max=100.0, default=10.0, update=_changed,
    )
    release: IntProperty(
        name="Release of Lamps", options={'HIDDEN'},
        description="Whether a lamp in which nothing was chosen casts the shadow of its own shape (2), or one width as "
                    "in the release that saved the file (1)",
    )
    world_light: EnumProperty(
        name="World Light",
        description="How the world lights surfaces",
        items=(
            ('AMBIENT', "Ambient", "The world's mean color lights all surfaces alike, also where nothing of the world "
             "is seen: the method as published, and fastest", 0),
            ('SKY', "Sky", "The world lights from all around: less where something is in the way", 1),
        ),
        default='SKY', update=_changed,
    )
    bounces: IntProperty(
        name="Bounces",
        description="How often light goes on from matt surface to matt surface. 0 leaves black what no lamp and no "
                    "sky lights",
        min=0, max=4, default=1, update=_changed,
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
    use_pass_ambient: _pass("Ambient", "Deliver the world's light on surfaces, which is not affected by shadows")
    use_pass_debug_candidates: _pass(
        "Candidates", "Deliver how many nodes of the lattice were tested, over all surfaces seen in the pixel")
    use_pass_debug_m: _pass(
        "Nodes (m)", "Deliver how many nodes of the lattice were averaged, over all surfaces seen in the pixel. "
        "Nodes whose visibility did not matter are not counted")
    use_pass_debug_empty: _pass(
        "Empty Sets", "Deliver where no node of the lattice was found, so that the shadow is sharp")
    use_pass_debug_skipped: _pass(
        "Skipped", "Deliver where all nodes of the lattice agreed, so that their visibility did not matter")


class LightMeshesLight(bpy.types.PropertyGroup):
    shadow_pass: _pass(
        "Shadow Pass", "Deliver a separate pass that shows how much of this light reaches each surface: "
        "1 in its full light, 0 in its shadow. Lights that share this data share the pass, which is their mean")
    soft_shadows: BoolProperty(
        name="Soft Shadows",
        description="Let the shadows of this light have soft edges. Without it they are always sharp",
        default=True, update=_changed,
    )
    softness: EnumProperty(
        name="Softness",
        description="What sets the width of the edges of this light's shadows",
        items=(
            ('SCENE', "Scene", "The scene's step and quality, as for all lights", 0),
            ('RADIUS', "Own Radius", "A radius for this light alone", 1),
            ('LIGHT_SIZE', "Light Size", "The size of the light: edges are as wide as those of a real lamp of this "
             "size, at one distance", 2),
            ('SIZE', "Lamp Shape", "The shadow of the lamp's own sphere, disc of the sky or face: sharp where things "
             "touch, and wider farther away. All of the lamp gives light", 3),
        ),
        default='SIZE', update=_changed,
    )
    radius: FloatProperty(
        name="Edge Radius",
        description="Half the width of the edges of this light's shadows. Larger makes them softer, and rendering "
                    "slower if it is many steps (h) long: at most 16. 0 makes them sharp",
        subtype='DISTANCE', unit='LENGTH', min=0.0, soft_max=10.0, default=0.15, precision=4, update=_changed,
    )
    reference_distance: FloatProperty(
        name="Distance",
        description="The distance between a caster and its shadow at which the edges are as wide as those of a real "
                    "lamp of this size: farther is wider. 0 measures it from what the camera sees",
        subtype='DISTANCE', unit='LENGTH', min=0.0, soft_max=100.0, default=0.0, precision=4, update=_changed,
    )


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
