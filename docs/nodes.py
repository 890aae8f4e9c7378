"""Write the table of Blender's shader nodes in materials.md: `python docs/nodes.py`, in a Python that has bpy.

The table says of each node of this bpy whether the add-on translates it, from the add-on's own tables.
"""

import re
from pathlib import Path

import bpy
from light_meshes_addon.export import node_values, surface_nodes

PAGE = Path(__file__).with_name("materials.md")
BLOCK = re.compile(r"(<!-- nodes -->\n).*?(\n<!-- end -->)", re.S)
# What is read elsewhere than in the two tables.
ELSEWHERE = {'ShaderNodeBackground': "of the world", 'ShaderNodeGroup': "followed, nested groups too",
             'ShaderNodeOutputMaterial': "", 'ShaderNodeOutputLight': "", 'ShaderNodeOutputWorld': ""}
# What a translated node does otherwise than in Cycles.
NEARLY = {
    'ShaderNodeDisplacement': "as bumps", 'ShaderNodeVectorDisplacement': "as bumps",
    'ShaderNodeBsdfPrincipled': "without subsurface, anisotropy, thin film",
    'ShaderNodeBsdfGlossy': "isotropic", 'ShaderNodeBsdfAnisotropic': "isotropic",
    'ShaderNodeBsdfMetallic': "isotropic",
    'ShaderNodeBsdfGlass': "shadows as of clear glass", 'ShaderNodeBsdfRefraction': "shadows as of clear glass",
    'ShaderNodeTexSky': "Hosek / Wilkie as Preetham",
    'ShaderNodeLightFalloff': "at surfaces Quadratic without Smooth; in lamps all",
    'ShaderNodeLightPath': "without Ray Length and depths; in lamps with both",
}


def rows():
    """Return (label, yes or nearly or no, remark) for each shader node that this bpy can make, in order of labels."""
    tree = bpy.data.materials.new("nodes").node_tree
    found = []
    for name in sorted(n for n in dir(bpy.types) if n.startswith("ShaderNode")):
        try:
            node = tree.nodes.new(name)
        except RuntimeError:  # of freestyle's trees, or a base class
            continue
        known = name in node_values.NODES or name in surface_nodes._SHADERS or name in ELSEWHERE
        remark = NEARLY.get(name, ELSEWHERE.get(name, ""))
        found.append((node.bl_label, ("nearly" if name in NEARLY else "yes") if known else "no", remark))
        tree.nodes.remove(node)
    return sorted(set(found))


def table():
    """Return the Markdown table of `rows`."""
    return "\n".join(["| node | translated | |", "| --- | --- | --- |", *(
        f"| {label} | {said} | {remark} |" for label, said, remark in rows())])


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda m: m[1] + table() + m[2], text), encoding="utf-8")
