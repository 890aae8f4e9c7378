"""Shader nodes become Whitted's parameters; nodes that cannot be translated are named in a warning."""

import os
import subprocess

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest


def mixed(name, kind, first, second, factor=None):
    """A material that mixes or adds two shader nodes, given as (idname, inputs)."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    both = tree.nodes.new(kind)
    for i, (idname, inputs) in enumerate((first, second)):
        node = tree.nodes.new(idname)
        for key, value in inputs.items():
            node.inputs[key].default_value = value
        tree.links.new(node.outputs[0], both.inputs[i + len(both.inputs) - 2])
    if factor is not None:
        both.inputs[0].default_value = factor
    tree.links.new(both.outputs[0], tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
    return material


def test_diffuse(translated, diffuse):
    found, scene = translated(diffuse((0.1, 0.2, 0.3)))
    assert found.Od == pytest.approx((0.1, 0.2, 0.3)) and (found.kd, found.ka, found.ks) == (1, 1, 0)
    assert found.mirror == (0, 0, 0) and not scene.warnings


def test_principled(translated, node_material):
    material = node_material("Plastic", 'ShaderNodeBsdfPrincipled', Base_Color=(0.5, 0.4, 0.3, 1), Roughness=0.5,
                             Emission_Color=(1, 0.5, 0, 1), Emission_Strength=2)
    found, scene = translated(material)
    assert found.Od == pytest.approx((0.5, 0.4, 0.3)) and found.kd == 1 and found.ka == 1
    assert found.emission == pytest.approx((2, 1, 0)) and found.mirror == (0, 0, 0)
    # α = ¼, n = (2/α² − 2)/4, ks = F0·(n + 2)/2 with F0 = 4 %.
    assert found.nShiny == pytest.approx(7.5) and found.ks == pytest.approx(0.04 * 4.75)
    assert found.Os == pytest.approx((1, 1, 1)) and not scene.warnings


def test_metal(translated, node_material):
    material = node_material("Gold", 'ShaderNodeBsdfPrincipled', Base_Color=(1, 0.8, 0.3, 1), Metallic=1, Roughness=0.4)
    found, _ = translated(material)
    assert found.kd == found.ka == 0 and found.blurred  # the world is seen in it
    assert found.Os == pytest.approx((1, 0.8, 0.3)) and found.ks > 1
    material = node_material("Chrome", 'ShaderNodeBsdfPrincipled', Base_Color=(0.9, 0.9, 0.9, 1), Metallic=1,
                             Roughness=0)
    found, _ = translated(material)
    assert found.mirror == pytest.approx((0.9,) * 3) and found.ka == found.kd == 0
    assert found.nShiny < 1000 and np.isfinite(found.ks)


def test_a_mirror_fades_with_roughness(translated, node_material):
    levels = [translated(node_material(f"R{r}", 'ShaderNodeBsdfPrincipled', Metallic=1, Roughness=r))[0].mirror[0]
              for r in (0.0, 0.1, 0.125, 0.15, 0.3)]
    assert levels == pytest.approx([0.8, 0.8, 0.4, 0, 0], abs=1e-5)


def test_glossy_and_emission(translated, node_material):
    found, scene = translated(node_material("Mirror", 'ShaderNodeBsdfAnisotropic' if not hasattr(
        bpy.types, "ShaderNodeBsdfGlossy") else 'ShaderNodeBsdfGlossy', Color=(0.5, 0.6, 0.7, 1), Roughness=0.05))
    assert found.mirror == pytest.approx((0.5, 0.6, 0.7)) and found.kd == 0 and not scene.warnings
    found, scene = translated(node_material("Lamp", 'ShaderNodeEmission', Color=(1, 0, 0.5, 1), Strength=4))
    assert found.emission == pytest.approx((4, 0, 2)) and (found.kd, found.ka, found.ks) == (0, 0, 0)


def test_mix_and_add(translated):
    material = mixed("Mixed", 'ShaderNodeMixShader', ('ShaderNodeBsdfDiffuse', {"Color": (1, 0, 0, 1)}),
                     ('ShaderNodeEmission', {"Color": (0, 1, 0, 1), "Strength": 2}), 0.25)
    found, scene = translated(material)
    assert found.kd == pytest.approx(0.75) and found.Od == pytest.approx((1, 0, 0))
    assert found.emission == pytest.approx((0, 0.5, 0)) and not scene.warnings
    material = mixed("Added", 'ShaderNodeAddShader', ('ShaderNodeBsdfDiffuse', {"Color": (0.5, 0, 0, 1)}),
                     ('ShaderNodeBsdfDiffuse', {"Color": (0, 0.3, 0, 1)}))
    found, _ = translated(material)
    assert [found.kd * c for c in found.Od] == pytest.approx((0.5, 0.3, 0))
    material = mixed("One side", 'ShaderNodeMixShader', ('ShaderNodeBsdfDiffuse', {"Color": (0.2, 0.2, 0.2, 1)}),
                     ('ShaderNodeBsdfGlass', {}), 0.0)
    found, scene = translated(material)
    assert found.kd == 1 and found.Od == pytest.approx((0.2,) * 3) and not scene.warnings


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_without_nodes(translated):
    material = bpy.data.materials.new("Plain")
    material.diffuse_color = (0.2, 0.4, 0.6, 1)
    if bpy.app.version < (5, 0):
        material.use_nodes = False
        found, _ = translated(material)
        assert found.Od == pytest.approx((0.2, 0.4, 0.6))


def outputs(material, colors):
    """Give the material an output for each target: a diffuse surface of that colour; the last is the active one."""
    tree = material.node_tree
    tree.nodes.clear()
    for target, color in colors:
        shader, output = tree.nodes.new('ShaderNodeBsdfDiffuse'), tree.nodes.new('ShaderNodeOutputMaterial')
        shader.inputs["Color"].default_value = (*color, 1)
        output.target = target
        tree.links.new(shader.outputs[0], output.inputs[0])
        tree.nodes.active = output


RED, GREEN, BLUE = (0.8, 0, 0), (0, 0.8, 0), (0, 0, 0.8)


@pytest.mark.parametrize("colors", [
    [('ALL', RED), ('CYCLES', GREEN), ('EEVEE', BLUE)], [('CYCLES', RED), ('ALL', GREEN)], [('EEVEE', RED)],
    [('ALL', RED), ('ALL', GREEN)], [('EEVEE', RED), ('ALL', GREEN)], [('CYCLES', RED), ('CYCLES', GREEN)],
])
def test_of_several_outputs_it_is_that_of_cycles(scene, add_plane, add_light, diffuse, render, colors):
    material = diffuse()
    outputs(material, colors)
    add_plane(5).data.materials.append(material)
    add_light('SUN', energy=3.14159, angle=0)
    scene.light_meshes.shadows = 'SHARP'
    ours = render(scene)["Combined"][24, 32, :3]
    scene.render.engine = 'CYCLES'
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 4, False, 0
    assert ours == pytest.approx(render(scene)["Combined"][24, 32, :3], abs=2e-3)


OLD = """
import bpy, os, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
mesh = bpy.data.meshes.new("Plane")
mesh.from_pydata([(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)], [], [(0, 1, 2, 3)])
material = bpy.data.materials.new("Old")
material.diffuse_color, material.metallic, material.roughness = (0.2, 0.4, 0.6, 1), 0.7, 0.3
mesh.materials.append(material)
scene = bpy.context.scene
sun = bpy.data.lights.new("Sun", 'SUN')
sun.energy, sun.angle = 3.14159, 0
for data in (mesh, sun, bpy.data.cameras.new("Camera")):
    ob = bpy.data.objects.new(data.name, data)
    ob.location.z = 0 if data == mesh else 10
    scene.collection.objects.link(ob)
scene.camera = ob
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.slow
def test_an_old_material_without_nodes_is_that_of_cycles(scene, render, tmp_path):
    """Blender 5 gives it nodes with an output for each engine."""
    python = next((p for p in os.environ.get("LIGHT_MESHES_BPY_PYTHONS", "").split(os.pathsep) if "4.2" in p), None)
    if not python:
        pytest.skip("LIGHT_MESHES_BPY_PYTHONS names no Python with bpy 4.2")
    subprocess.run([python, "-c", OLD, str(tmp_path / "old.blend")], check=True, capture_output=True, timeout=60)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "old.blend"))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.light_meshes.shadows = 'SHARP'
    pictures = []
    for engine in ('LIGHT_MESHES', 'CYCLES'):
        scene.render.engine = engine
        scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 4, False, 0
        pictures.append(render(scene)["Combined"][24, 32, :3])
    assert pictures[0] == pytest.approx(pictures[1], abs=2e-3) and pictures[0].max() > 0.1


def test_constants_through_nodes(translated, node_material):
    material = node_material("Linked", 'ShaderNodeBsdfDiffuse')
    tree = material.node_tree
    rgb, reroute = tree.nodes.new('ShaderNodeRGB'), tree.nodes.new('NodeReroute')
    rgb.outputs[0].default_value = (0.9, 0.1, 0.4, 1)
    tree.links.new(rgb.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], tree.nodes["Diffuse BSDF"].inputs["Color"])
    found, scene = translated(material)
    assert found.Od == pytest.approx((0.9, 0.1, 0.4)) and not scene.warnings


@pytest.mark.parametrize(("idname", "label"), [
    ('ShaderNodeBsdfToon', "Toon BSDF"),
    ('ShaderNodeSubsurfaceScattering', "Subsurface"), ('ShaderNodeBsdfHair', "Hair BSDF"),
])
def test_untranslated_shaders_are_named(translated, node_material, idname, label):
    found, scene = translated(node_material("Odd", idname, Color=(0.3, 0.6, 0.2, 1)))
    assert found.Od == pytest.approx((0.3, 0.6, 0.2)) and found.kd == 1
    assert len(scene.warnings) == 1 and "'Odd'" in scene.warnings[0] and label in scene.warnings[0]


def test_rough_diffuse_translucent_and_frosted(translated, node_material):
    found, scene = translated(node_material("Leaf", 'ShaderNodeBsdfTranslucent', Color=(0.3, 0.6, 0.2, 1)))
    assert found.translucent == pytest.approx((0.3, 0.6, 0.2)) and found.kd == found.ka == 0 and not scene.warnings
    found, scene = translated(node_material("Clay", 'ShaderNodeBsdfDiffuse', Roughness=0.7))
    assert found.diffuse_roughness == pytest.approx(0.7) and found.translucent == (0, 0, 0) and not scene.warnings
    found, scene = translated(node_material("Frosted", 'ShaderNodeBsdfGlass', Roughness=0.3))
    assert found.frosted == pytest.approx(0.3) and "shadows of the rough glass" in scene.warnings[0]
    both = mixed("Both", 'ShaderNodeMixShader', ('ShaderNodeBsdfDiffuse', {"Roughness": 0.4}),
                 ('ShaderNodeBsdfTranslucent', {"Color": (1, 1, 1, 1)}), 0.25)
    found, _ = translated(both)
    assert (found.kd, found.translucent) == (0.75, (0.25,) * 3) and found.diffuse_roughness == pytest.approx(0.4)


def test_untranslated_inputs_are_named(translated, node_material):
    material = node_material("Wood", 'ShaderNodeBsdfPrincipled', Base_Color=(0.3, 0.2, 0.1, 1), Subsurface_Weight=0.5)
    tree = material.node_tree
    principled = tree.nodes["Principled BSDF"]
    occlusion, bevel = tree.nodes.new('ShaderNodeAmbientOcclusion'), tree.nodes.new('ShaderNodeBevel')
    occlusion.inputs["Color"].default_value = (0.3, 0.2, 0.1, 1)
    tree.links.new(occlusion.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(bevel.outputs[0], principled.inputs["Normal"])
    found, scene = translated(material)
    assert found.Od == pytest.approx((0.3, 0.2, 0.1))
    text = "\n".join(scene.warnings)
    assert len(scene.warnings) == 3 and all(w in text for w in ("Subsurface Weight", "Ambient Occlusion", "Bevel"))
    assert "(0.3, 0.2, 0.1)" in text  # the mean that is used
    assert not found.program
    assert all("'Wood'" in w for w in scene.warnings)


def test_no_output_node(translated, node_material):
    material = node_material("Lost", 'ShaderNodeBsdfDiffuse')
    material.node_tree.nodes.remove(material.node_tree.nodes["Material Output"])
    found, scene = translated(material)
    assert found.kd == 0 and found.emission == (0, 0, 0) and "'Lost'" in scene.warnings[0]


# Images

def textured(image, name="Textured", **settings):
    """A diffuse material of an image texture."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    texture = tree.nodes.new('ShaderNodeTexImage')
    texture.image = image
    for key, value in settings.items():
        setattr(texture, key, value)
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


@pytest.fixture
def four(tmp_path):
    """A 2×2 PNG: red and green above, blue and white below."""
    path = tmp_path / "four.png"
    pixels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(2, 2, 3, oiio.UINT8))
    out.write_image(pixels)
    out.close()
    return path


def pixels_of(image):
    file = oiio.ImageInput.open(image.path)
    spec = file.spec()
    return np.asarray(file.read_image(oiio.FLOAT)).reshape(spec.height, spec.width, spec.nchannels)[..., :3]


@pytest.fixture
def add_mapped(add_plane):
    """A plane with a UV map that covers the image once."""
    def make(material, name="Mapped"):
        plane = add_plane(name=name)
        layer = plane.data.uv_layers.new(name="UVMap")
        layer.data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
        plane.data.materials.append(material)
        return plane
    return make


def test_image_file(scene, add_mapped, add_plane, diffuse, snapshot, four):
    image = bpy.data.images.load(str(four))
    add_mapped(textured(image, interpolation='Closest', extension='CLIP'))
    add_plane(name="Bare").data.materials.append(diffuse())
    found = snapshot(scene)
    (description,) = found.images
    assert description.path == str(four.resolve()) and description.colorspace == 'sRGB'
    assert (description.interpolation, description.extension) == ('CLOSEST', 'CLIP')
    assert [m.image for m in found.materials] == [0, -1] and not found.warnings
    uv = found.geometry.uvs
    assert uv.shape == (4, 3, 2) and uv[:2].min() == 0 and uv[:2].max() == 1 and not uv[2:].any()


def test_no_image_no_uvs(scene, add_mapped, diffuse, snapshot):
    add_mapped(diffuse())
    assert len(snapshot(scene).geometry.uvs) == 0


def test_packed_generated_and_painted_images(scene, add_mapped, snapshot, four):
    packed = bpy.data.images.load(str(four))
    packed.pack()
    four.unlink()
    generated = bpy.data.images.new("Generated", 4, 4, float_buffer=True)
    generated.generated_color = (0.25, 0.5, 2, 1)
    painted = bpy.data.images.new("Painted", 2, 1)
    painted.pixels = [1, 0, 0, 1, 0, 1, 0, 1]
    for image in (packed, generated, painted):
        add_mapped(textured(image, image.name))
    found = snapshot(scene)
    images = {i.name: i for i in found.images}
    assert np.allclose(pixels_of(images["four.png"]), [[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]])
    assert np.allclose(pixels_of(images["Generated"]), generated.pixels[:3], rtol=1e-5)
    assert np.allclose(pixels_of(images["Painted"]), [[[1, 0, 0], [0, 1, 0]]])
    assert images["Generated"].colorspace == 'LINEAR' and images["Painted"].colorspace == 'sRGB'


def test_colour_space_of_data(scene, add_mapped, snapshot, four):
    image = bpy.data.images.load(str(four))
    image.colorspace_settings.name = 'Non-Color'
    add_mapped(textured(image))
    assert snapshot(scene).images[0].colorspace == 'LINEAR'


def test_named_uv_map(scene, add_mapped, snapshot, four):
    material = textured(bpy.data.images.load(str(four)))
    plane = add_mapped(material)
    other = plane.data.uv_layers.new(name="Other")
    other.data.foreach_set("uv", [0.5] * 8)
    tree = material.node_tree
    node = tree.nodes.new('ShaderNodeUVMap')
    node.uv_map = "Other"
    tree.links.new(node.outputs[0], tree.nodes["Image Texture"].inputs["Vector"])
    found = snapshot(scene)
    assert np.allclose(found.geometry.uvs, 0.5) and not found.warnings


def test_what_is_wrong_with_an_image_is_said(scene, add_plane, add_mapped, snapshot, four, tmp_path):
    image = bpy.data.images.load(str(four))
    add_plane(name="Unmapped").data.materials.append(textured(image))
    lost = bpy.data.images.load(str(four))
    lost.name = "Lost"
    lost.filepath = str(tmp_path / "nowhere.png")
    lost.reload()
    add_mapped(textured(lost, "Without"))
    mapped = textured(image, "Moved")
    tree = mapped.node_tree
    mapping = tree.nodes.new('ShaderNodeMapping')
    tree.links.new(mapping.outputs[0], tree.nodes["Image Texture"].inputs["Vector"])
    add_mapped(mapped)
    found = snapshot(scene)
    text = "\n".join(found.warnings)
    assert all(word in text for word in ("'Unmapped': it has no UV map", "'Lost'")), text
    assert next(m for m in found.materials if m.name == "Without").image >= 0  # magenta, see test_addon_images


def test_texture_in_the_picture(scene, add_mapped, add_light, render, four):
    """The four quarters of the image are where Blender shows them, in the right colours."""
    plane = add_mapped(textured(bpy.data.images.load(str(four)), interpolation='Closest'))
    plane.scale = (3, 3, 1)
    add_light('SUN', energy=3.14159, angle=0)
    scene.light_meshes.shadows = 'SHARP'
    for node in plane.data.materials[0].node_tree.nodes:
        if node.type == 'BSDF_PRINCIPLED':
            node.inputs["Specular IOR Level"].default_value = 0
    picture = render(scene)["Combined"]
    quarters = [picture[y, x, :3] for y, x in ((16, 24), (16, 40), (32, 24), (32, 40))]
    assert np.allclose(quarters, [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], atol=0.01)


def test_material_in_the_picture(scene, add_plane, diffuse, add_light, render):
    plane = add_plane(5)
    material = diffuse((0.5, 0.5, 0.5))
    plane.data.materials.append(material)
    add_light('SUN', energy=3.14159, angle=0)
    assert render(scene)["Combined"][24, 32, 0] == pytest.approx(0.5, abs=0.01)
    material.light_meshes.override_kd = True
    material.light_meshes.kd = 0.2
    assert render(scene)["Combined"][24, 32, 0] == pytest.approx(0.1, abs=0.01)
