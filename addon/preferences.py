"""The add-on's preferences: which Python runs the engine."""

import bpy

from . import engine_python


def _python_changed(preferences, context):
    if preferences.python.startswith("//"):
        # Blender's file browser may give a path relative to the open file. It must not mean another Python when another
        # file is open.
        preferences.python = bpy.path.abspath(preferences.python)  # this calls this function again
    else:
        engine_python.set_python(preferences.python)


class LightMeshesPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Engine's Python",
        description="Another Python that runs the render engine, for developers; it must have the package "
                    "light-meshes. Empty: Blender's own Python, with the packages that the add-on brings along",
        subtype='FILE_PATH', update=_python_changed,
    )

    def draw(self, context):
        self.layout.prop(self, "python")


def register() -> None:
    bpy.utils.register_class(LightMeshesPreferences)
    engine_python.set_installed(__package__.startswith("bl_ext."))
    # This is read at registration, because a render must not use the context. There is no entry if a script, and not a
    # user, registered the add-on.
    addon = bpy.context.preferences.addons.get(__package__)
    if addon and addon.preferences:
        _python_changed(addon.preferences, None)
    engine_python.compile_modules()


def unregister() -> None:
    bpy.utils.unregister_class(LightMeshesPreferences)
