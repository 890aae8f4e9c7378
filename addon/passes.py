"""The only list of render passes. Registration, the request to the engine, the picture and the panel all use it."""

from typing import NamedTuple

import bpy

from . import cryptomatte


class Pass(NamedTuple):
    """A render pass, with its names in Blender and in the engine."""

    name: str  # its name in Blender
    engine_name: str
    channel_ids: str
    kind: str  # how the compositor interprets it
    switch: str = ""  # the property that switches it on: of the view layer,
    own: bool = False  # or of the view layer's `light_meshes` (for passes that Blender does not have)

    @property
    def channels(self) -> int:
        return len(self.channel_ids)

    def owner(self, view_layer):
        """Return the object that has the property `switch`."""
        return view_layer.light_meshes if self.own else view_layer


def _since_5(new: str, old: str) -> str:
    return new if bpy.app.version >= (5, 0) else old


_ALL = (
    Pass("Combined", "Combined", "RGBA", 'COLOR', "use_pass_combined"),
    Pass("Depth", "Depth", "Z", 'VALUE', "use_pass_z"),
    Pass("Mist", "Mist", "Z", 'VALUE', "use_pass_mist"),
    Pass("Position", "Position", "XYZ", 'VECTOR', "use_pass_position"),
    Pass("Normal", "Normal", "XYZ", 'VECTOR', "use_pass_normal"),
    Pass("UV", "UV", "UVA", 'VECTOR', "use_pass_uv"),
    Pass(_since_5("Object Index", "IndexOB"), "Object Index", "X", 'VALUE', "use_pass_object_index"),
    Pass(_since_5("Material Index", "IndexMA"), "Material Index", "X", 'VALUE', "use_pass_material_index"),
    Pass(_since_5("Diffuse Direct", "DiffDir"), "Diffuse", "RGB", 'COLOR', "use_pass_diffuse_direct"),
    Pass(_since_5("Diffuse Indirect", "DiffInd"), "Diffuse Indirect", "RGB", 'COLOR', "use_pass_diffuse_indirect"),
    Pass(_since_5("Glossy Direct", "GlossDir"), "Glossy", "RGB", 'COLOR', "use_pass_glossy_direct"),
    Pass(_since_5("Transmission Direct", "TransDir"), "Transmission", "RGB", 'COLOR', "use_pass_transmission_direct"),
    Pass(_since_5("Emission", "Emit"), "Emission", "RGB", 'COLOR', "use_pass_emit"),
    Pass(_since_5("Environment", "Env"), "Environment", "RGB", 'COLOR', "use_pass_environment"),
    Pass("Ambient", "Ambient", "RGB", 'COLOR', "use_pass_ambient", own=True),
    Pass(_since_5("Ambient Occlusion", "AO"), "Ambient Occlusion", "RGB", 'COLOR', "use_pass_ambient_occlusion"),
    Pass("Shadow", "Shadow", "RGB", 'COLOR', "use_pass_shadow"),
    Pass("Debug Candidates", "Debug Candidates", "X", 'VALUE', "use_pass_debug_candidates", own=True),
    Pass("Debug m", "Debug m", "X", 'VALUE', "use_pass_debug_m", own=True),
    Pass("Debug Empty", "Debug Empty", "X", 'VALUE', "use_pass_debug_empty", own=True),
    Pass("Debug Skipped", "Debug Skipped", "X", 'VALUE', "use_pass_debug_skipped", own=True),
)
ALL = {p.engine_name: p for p in _ALL}
# The groups of the panel.
DATA = ("Combined", "Depth", "Mist", "Position", "Normal", "UV", "Object Index", "Material Index")
LIGHT = ("Diffuse", "Diffuse Indirect", "Glossy", "Transmission", "Emission", "Ambient", "Environment", "Shadow",
         "Ambient Occlusion")
DEBUG = ("Debug Candidates", "Debug m", "Debug Empty", "Debug Skipped")


def wanted(scene, view_layer) -> list[Pass]:
    """Return the passes that `view_layer` asks for, and those of the lights of `scene`. Blender always asks for
    Combined.
    """
    own = [p for p in _ALL if p.name == "Combined" or getattr(p.owner(view_layer), p.switch)]
    mattes = [Pass(f"{kind}{i:02d}", f"{kind}{i:02d}", "rgba", 'COLOR')
              for kind in cryptomatte.wanted(view_layer) for i in range(cryptomatte.levels(view_layer))]
    return own + mattes + _shadow_passes(scene)


def missing(scene, view_layer) -> list[str]:
    """Return a sentence for each pass of `view_layer` that the compositor of `scene` uses but does not get."""
    tree = scene.compositing_node_group if bpy.app.version >= (5, 0) else scene.use_nodes and scene.node_tree
    if not (tree and scene.render.use_compositing):
        return []
    given = {"Image", "Alpha", *(p.name for p in wanted(scene, view_layer))}
    known = {p.name for p in _ALL} | {f"{kind}00" for kind in cryptomatte.KINDS}
    lacking: dict[str, None] = {}
    todo, done = [tree], set()
    while todo:
        tree = todo.pop()
        done.add(tree)
        for node in tree.nodes:
            if getattr(node, "node_tree", None) and node.node_tree not in done:
                todo.append(node.node_tree)
            of_us = not node.mute and getattr(node, "scene", None) == scene
            if of_us and node.bl_idname == 'CompositorNodeRLayers' and node.layer == view_layer.name:
                lacking.update((link.from_socket.name, None) for link in tree.links if link.from_node == node)
            elif of_us and node.bl_idname == 'CompositorNodeCryptomatteV2' and node.source == 'RENDER':
                layer, _, kind = node.layer_name.rpartition(".")
                if layer == view_layer.name:
                    lacking[f"{kind}00"] = None
    sentences = []
    for name in (name for name in lacking if name not in given):
        if name in known:
            sentences.append(f"The compositor uses the pass '{name}' of view layer '{view_layer.name}', which is not "
                             "switched on in the View Layer properties")
        else:
            sentences.append(f"The compositor uses the pass '{name}' of view layer '{view_layer.name}', which Light "
                             "Meshes does not have: it is empty")
    return sentences


def shadow_number(light) -> int:
    """Return the number N of the engine's pass "Shadow N" for the data of a light, or −1 if the artist wants no such
    pass.

    It is the number that Blender gives to the data for this session. A name is not used, because it can change and can
    be any text.
    """
    return light.original.session_uid if light.light_meshes.shadow_pass else -1


def lights(scene) -> list:
    """Return the light data in `scene`, each once, sorted by name, including lights in collections that are
    instanced.
    """
    found, todo, done = {}, [scene.objects], set()
    while todo:
        for ob in todo.pop():
            if ob.type == 'LIGHT':
                found[ob.data.name_full] = ob.data
            elif ob.instance_type == 'COLLECTION' and ob.instance_collection:
                name = ob.instance_collection.name_full
                if name not in done:
                    done.add(name)
                    todo.append(ob.instance_collection.all_objects)
    return [found[name] for name in sorted(found)]


def _shadow_passes(scene) -> list[Pass]:
    if not any(light.light_meshes.shadow_pass for light in bpy.data.lights):
        return []  # then it is not necessary to look at all objects
    passes: dict[str, Pass] = {}
    for light in lights(scene):
        if light.light_meshes.shadow_pass:
            # A dot would end the layer's name in a multilayer EXR, and Blender cuts names at 63 bytes.
            stem = f"Shadow {light.name_full}".replace(".", "_").encode()[:57].decode(errors="ignore")
            name, n = stem, 1
            while name in passes:
                n += 1
                name = f"{stem} ({n})"
            passes[name] = Pass(name, f"Shadow {shadow_number(light)}", "RGB", 'COLOR')
    return list(passes.values())
