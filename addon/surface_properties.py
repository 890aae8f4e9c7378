"""The properties that the artist sets on an object and on a material."""

import bpy
from bpy.props import BoolProperty, FloatProperty, FloatVectorProperty, IntProperty


def changed(settings, context):
    # Without this tag Blender gives the old values to the render: an add-on's properties reach the evaluated data only
    # when their owner is tagged.
    settings.id_data.update_tag()


def _surface_switches(whose: str, other: str) -> dict:
    """Return the two soft-shadow switches of an object, or of a material."""
    return {
        "cast_soft_shadows": BoolProperty(
            name="Cast Soft Shadows",
            description=f"Let the shadows that {whose} casts have soft edges. Without it they are sharp. "
                        f"They are soft where {other} allows it too",
            default=True, update=changed),
        "receive_soft_shadows": BoolProperty(
            name="Receive Soft Shadows",
            description=f"Let shadows that fall on {whose} have soft edges. Without it they are sharp. "
                        f"They are soft where {other} allows it too",
            default=True, update=changed),
    }


class LightMeshesObject(bpy.types.PropertyGroup):
    __annotations__ = _surface_switches("this object", "its material")


def _override_switched(name):
    def update(settings, context):
        # Start with the translated value that the picture showed, unless the property was set before.
        if getattr(settings, f"override_{name}") and not settings.is_property_set(name):
            from .export.materials import translated_value

            setattr(settings, name, translated_value(settings.id_data, name))
        changed(settings, context)
    return update


# The parameters of Whitted's shading that a material's nodes are translated to, and that the artist may override.
PARAMETERS = {
    "ka": FloatProperty(
        name="Ambient", description="How much of the world's color the surface reflects, in shadow too",
        min=0.0, soft_max=1.0, default=1.0, update=changed),
    "kd": FloatProperty(
        name="Diffuse", description="How bright the surface is where light falls on it",
        min=0.0, soft_max=1.0, default=1.0, update=changed),
    "Od": FloatVectorProperty(
        name="Color", description="Color of the lit and of the ambient surface; replaces an image too",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.8, 0.8, 0.8), update=changed),
    "ks": FloatProperty(
        name="Highlight", description="How bright the highlights of lights are",
        min=0.0, soft_max=10.0, default=0.0, update=changed),
    "Os": FloatVectorProperty(
        name="Highlight Color", description="Color of the highlights",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(1.0, 1.0, 1.0), update=changed),
    "nShiny": FloatProperty(
        name="Shininess", description="How small the highlights are: 1 is a broad sheen, 500 a bright dot",
        min=0.0, max=1e9, soft_min=1.0, soft_max=1000.0, default=50.0, update=changed),
    "mirror": FloatVectorProperty(
        name="Mirror", description="How much of its surroundings the surface mirrors. Black is no mirror",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.0, 0.0, 0.0), update=changed),
    "emission": FloatVectorProperty(
        name="Emission", description="Light that the surface gives by itself",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.0, 0.0, 0.0), update=changed),
    "kt": FloatVectorProperty(
        name="Transparency", description="How much light passes at each crossing of the surface, and in which color",
        subtype='COLOR', size=3, min=0.0, soft_max=1.0, default=(0.0, 0.0, 0.0), update=changed),
    "ior": FloatProperty(
        name="IOR", description="How strongly a closed mesh bends rays; 1 does not, glass is 1.5. "
        "An open mesh is a thin sheet and bends nothing",
        min=0.01, max=100.0, soft_min=1.0, soft_max=3.0, default=1.0, update=changed),
    "fresnel": BoolProperty(
        name="Fresnel", description="At flat angles reflect more light and let less through, as real glass does. "
        "Without it Mirror and Transparency are the same at all angles",
        default=False, update=changed),
    "alpha": FloatProperty(
        name="Alpha", description="How much of the surface is there: 0 is a hole", min=0.0, max=1.0, default=1.0,
        update=changed),
}


PRIORITY = IntProperty(
    name="Priority", description="Where closed meshes of glass overlap, the one with the highest priority counts: "
    "give a glass a higher priority than the water in it", min=0, max=100, default=0, update=changed)


class LightMeshesMaterial(bpy.types.PropertyGroup):
    __annotations__ = PARAMETERS | {"priority": PRIORITY} | _surface_switches("this material", "the object") | {
        f"override_{name}": BoolProperty(
            name=f"Override {parameter.keywords['name']}", default=False, update=_override_switched(name),
            description="Use the value here instead of the one translated from the nodes")
        for name, parameter in PARAMETERS.items()
    }


translated: dict[int, dict] = {}  # the translated values for the panel, by the material's session_uid


def _translated(name):
    """Return a color property that shows a translated value. It can be edited, because Blender dims colors that cannot;
    an edit makes it an override.
    """
    def override(own, value):
        settings = own.id_data.light_meshes
        setattr(settings, name, value)
        setattr(settings, f"override_{name}", True)
    return {"get": lambda own: translated[own.id_data.session_uid][name], "set": override}


class LightMeshesTranslated(bpy.types.PropertyGroup):
    """The colors that result from a material's nodes, for the panel to show."""

    __annotations__ = {
        name: FloatVectorProperty(
            name=parameter.keywords["name"], description="As translated from the nodes; another color overrides it",
            subtype='COLOR', size=3, **_translated(name))
        for name, parameter in PARAMETERS.items() if parameter.keywords.get("subtype") == 'COLOR'
    }
