"""Operators that an artist can run: set a quality preset, soften shadows, write a snapshot for a bug report."""

import shutil
from pathlib import Path
from typing import NamedTuple

import bpy

from .softness import has_size


class Preset(NamedTuple):
    """The settings of one quality level. They change the look only where a difference in quality is visible."""

    name: str
    description: str
    values: dict

    def is_set(self, own) -> bool:
        return all(getattr(own, key) == value for key, value in self.values.items())


# A point averages (2π/3)·kI³ nodes: 17, 57, 134 for kI 2, 3, 4. At the same h the cost of nodes and short rays grows in
# the same proportion.
PRESETS = {
    'DRAFT': Preset("Draft", "Fast: edges of objects are rough, those of shadows average some 17 nodes",
                    {"samples": 1, "kI": 2.0, "max_depth": 2, "light_samples": 16, "bounces": 0}),
    'BALANCED': Preset("Balanced", "Smooth at a normal look: edges of shadows average some 57 nodes",
                       {"samples": 4, "kI": 3.0, "max_depth": 4, "light_samples": 64, "bounces": 1}),
    'FINE': Preset("Fine", "For the last picture: 16 camera rays a pixel, edges of shadows average some 134 nodes",
                   {"samples": 16, "kI": 4.0, "max_depth": 8, "light_samples": 256, "bounces": 2}),
}


class LIGHT_MESHES_OT_preset(bpy.types.Operator):
    bl_idname = "light_meshes.preset"
    bl_label = "Quality Preset"
    bl_options = {'REGISTER', 'UNDO'}  # noqa: RUF012  Blender's own way

    level: bpy.props.EnumProperty(items=[(key, p.name, p.description, i) for i, (key, p) in enumerate(PRESETS.items())])

    @classmethod
    def description(cls, context, properties):
        return (f"{PRESETS[properties.level].description}. A step set by hand is changed with the quality, so that "
                "shadow edges stay as wide as they are; with the automatic step they get wider with the quality")

    def execute(self, context):
        own = context.scene.light_meshes
        r = own.h * own.kI
        for key, value in PRESETS[self.level].values.items():
            setattr(own, key, value)
        if not own.auto_h:
            own.h = r / own.kI
        return {'FINISHED'}


class LIGHT_MESHES_OT_soften(bpy.types.Operator):
    bl_idname = "light_meshes.soften"
    bl_label = "Soften from Lamp Sizes"
    bl_description = ("Let each lamp of the scene that has a size cast the shadow of its own shape: sharp where things "
                      "touch, and wider farther away. Switches the automatic step on")
    bl_options = {'REGISTER', 'UNDO'}  # noqa: RUF012

    def execute(self, context):
        lamps = {ob.data for ob in context.scene.objects if ob.type == 'LIGHT' and not ob.data.library}
        sized = [lamp for lamp in lamps if has_size(lamp)]
        if not sized:
            self.report({'ERROR'}, "no lamp has a size: set the Radius of a point or spot light, or the Angle of a sun")
            return {'CANCELLED'}
        for lamp in sized:
            lamp.light_meshes.softness = 'SIZE'
        context.scene.light_meshes.auto_h = True
        self.report({'INFO'}, f"Lamps with shadows of their own shape: {len(sized)}")
        return {'FINISHED'}


class LIGHT_MESHES_OT_keep_snapshot(bpy.types.Operator):
    bl_idname = "light_meshes.keep_snapshot"
    bl_label = "Keep Snapshot…"
    bl_description = ("Write what the engine gets for the current frame into a new folder, for a bug report. "
                      "It can be rendered again without Blender")

    directory: bpy.props.StringProperty(name="Folder", description="Where the snapshot's folder is made",
                                        subtype='DIR_PATH')
    filter_folder: bpy.props.BoolProperty(default=True, options={'HIDDEN'})

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {'RUNNING_MODAL'}

    def execute(self, context):
        from .render_engine import export_frame

        scene = context.scene
        name = bpy.path.clean_name(f"{Path(bpy.data.filepath).stem or 'untitled'}-{scene.name}-{scene.frame_current}")
        parent = Path(bpy.path.abspath(self.directory)) if self.directory else Path.cwd()
        folder, n = parent / f"snapshot-{name}", 1
        while folder.exists():
            folder, n = parent / f"snapshot-{name}-{n + 1}", n + 1
        try:
            folder.mkdir(parents=True)
            try:
                export_frame(scene, folder)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        except (OSError, RuntimeError) as e:
            self.report({'ERROR'}, f"{folder} cannot be made: {e.strerror}" if isinstance(e, OSError) else
                        str(e).strip().removeprefix("Error: "))
            return {'CANCELLED'}
        self.report({'INFO'}, f"The snapshot is in {folder}. Render it again with: "
                              f"light-meshes render \"{folder}\" -o picture.png")
        return {'FINISHED'}


_CLASSES = (LIGHT_MESHES_OT_preset, LIGHT_MESHES_OT_soften, LIGHT_MESHES_OT_keep_snapshot)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
