"""Values of sockets: constants are folded, expressions become the program that the engine knows."""

from dataclasses import replace

import pytest
from light_meshes.scene import programs
from light_meshes_addon.export import node_values, values


def test_both_sides_count_the_same_outputs():
    many = {name: outputs for name, (_, outputs) in programs.OPERATIONS.items() if outputs > 1}
    assert many == values.OUTPUTS


def test_numbers_stay_numbers_and_equal_expressions_are_one():
    u, w = values.outputs("uv", 2)
    assert values.clamp(1.5) == 1.0 and values.power(2.0, 3.0) == 8.0 and values.divide(1.0, 0.0) == 0.0
    assert u * 0 == 0.0 and u * 1 is u and u + 0 is u and values.mixed(u, w, 1.0) is w
    assert u * 2 + w is values.operation("uv", output=0) * 2 + w
    with pytest.raises(TypeError):
        bool(u > 1)  # which would be right nowhere on the surface


def test_a_program_is_written_once_and_read_by_the_engine():
    u, w = values.outputs("uv", 2)
    shared = u * w
    operations, results = values.compiled({"alpha": shared + 1.0, "Od": [shared, 0.5, u]})
    assert [name for name, *_ in operations] == ["uv", "multiply", "add"]
    program = programs.program({"operations": operations, "values": results}, "material")
    assert program.values["Od"] == ((2,), 0.5, (0,)) and program.needed(["Od"]) == ([True, True, False], {0, 1, 2})


def test_a_deep_tree_needs_no_recursion():
    value = values.operation("uv")
    for i in range(20_000):
        value = value + (i + 1.0)
    operations, _ = values.compiled({"alpha": value})
    assert len(operations) == 20_001
    values.forget()


def test_the_table_of_nodes_names_nodes_of_blender():
    import bpy

    unknown = {name for name in node_values.NODES if not hasattr(bpy.types, name)}
    assert unknown <= {'ShaderNodeCombineRGB', 'ShaderNodeSeparateRGB', 'ShaderNodeCombineHSV',
                       'ShaderNodeSeparateHSV'}  # of older releases


def test_the_page_says_of_each_node_what_the_add_on_does_with_it():
    """Which nodes there are depends on the bpy: those of this one stand on the page as `docs/nodes.py` has them."""
    import re
    import runpy
    from pathlib import Path

    docs = Path(__file__).parents[2] / "docs"
    page = (docs / "materials.md").read_text(encoding="utf-8")
    said = dict(re.findall(r"^\| ([^|]+) \| (yes|nearly|no) \|", page, re.M))
    rows = runpy.run_path(str(docs / "nodes.py"))["rows"]()
    assert len(rows) > 80
    assert not {label: answer for label, answer, _ in rows if said.get(label, answer) != answer}
    assert sum(label in said for label, _, _ in rows) > 80


def test_every_translated_node_is_shown_beside_cycles():
    """By the catalogue with each of its choices, or by another file of those that compare with Cycles."""
    from pathlib import Path

    from light_meshes_addon.export import node_values, surface_nodes
    from node_catalogue import INPUTS, VALUES

    tests = Path(__file__).parents[1]
    files = [*(tests / "peers").glob("*.py"), *(tests / "support").glob("node_*.py")]
    text = "".join(file.read_text(encoding="utf-8") for file in files)
    in_text = {name for name in (*node_values.NODES, *surface_nodes._SHADERS)
               if f"'{name}'" in text or f'"{name}"' in text}
    for short in ("Refraction", "Glossy"):  # named without their beginnings, or by their other name
        in_text |= {f"ShaderNodeBsdf{short}"}
    catalogue = {f"ShaderNode{name}" for name in (*VALUES, *INPUTS)}
    assert not {*node_values.NODES, *surface_nodes._SHADERS} - in_text - catalogue
    values = set(node_values.NODES) - catalogue
    assert values == {'ShaderNodeBump', 'ShaderNodeDisplacement', 'ShaderNodeVectorDisplacement', 'ShaderNodeTexImage',
                      'ShaderNodeTexEnvironment', 'ShaderNodeTexSky', 'ShaderNodeTexIES',
                      'ShaderNodeLightFalloff'}  # which have tests of their own


def test_constants_through_nodes_cost_nothing(translated, node_material):
    """Their material is the same in every number as that without these nodes, and has no program."""
    inputs = {"Base_Color": (0.25, 0.5, 0.125, 1), "Roughness": 0.5, "Metallic": 0.25, "Coat_Weight": 0.5}
    plain, _ = translated(node_material("Plain", 'ShaderNodeBsdfPrincipled', **inputs))
    material = node_material("Plain", 'ShaderNodeBsdfPrincipled', **inputs)
    tree, principled = material.node_tree, material.node_tree.nodes["Principled BSDF"]
    combine, value, math = (tree.nodes.new(f"ShaderNode{name}") for name in ("CombineXYZ", "Value", "Math"))
    for socket, number in zip(combine.inputs, inputs["Base_Color"], strict=False):
        socket.default_value = number
    value.outputs[0].default_value, math.operation, math.inputs[1].default_value = 0.25, 'ADD', 0.25
    tree.links.new(value.outputs[0], math.inputs[0])
    for output, name in ((combine.outputs[0], "Base Color"), (math.outputs[0], "Roughness"),
                         (value.outputs[0], "Metallic"), (math.outputs[0], "Coat Weight")):
        principled.inputs[name].default_value = (1, 1, 1, 1) if "Color" in name else 0.9
        tree.links.new(output, principled.inputs[name])
    found, scene = translated(material)
    assert replace(found, name=plain.name) == plain and not found.program and not scene.warnings


def test_varying_roughness_is_no_mirror_where_it_is_rough(translated, node_material):
    """What mirrors is said point by point, so that other surfaces' reflections need not light each point in full."""
    material = node_material("Rough", 'ShaderNodeBsdfPrincipled')
    tree = material.node_tree
    tree.links.new(tree.nodes.new('ShaderNodeTexNoise').outputs[0], tree.nodes["Principled BSDF"].inputs["Roughness"])
    found, _ = translated(material)
    assert found.blurred and {"roughness", "mirror"} <= set(found.program.values)
