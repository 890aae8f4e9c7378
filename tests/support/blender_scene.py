"""A scene with a known picture, as source code for a Blender or bpy of any version, and a function that reads
pictures.
"""

import numpy as np
import OpenImageIO as oiio

# A grey plane half as wide as the picture, under a sun, returns radiance 0.5; the world is black.
SCENE = """
import bpy, math
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
scene = bpy.context.scene
scene.render.engine = 'LIGHT_MESHES'
scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0  # what lamps give, and nothing else
scene.render.resolution_x, scene.render.resolution_y = 64, 48
def add(data, **properties):
    ob = bpy.data.objects.new(data.name, data)
    scene.collection.objects.link(ob)
    for key, value in properties.items():
        setattr(ob, key, value)
    return ob
mesh = bpy.data.meshes.new("Plane")
mesh.from_pydata([(-1.8, -1.8, 0), (1.8, -1.8, 0), (1.8, 1.8, 0), (-1.8, 1.8, 0)], [], [(0, 1, 2, 3)])
material = bpy.data.materials.new("Grey")
material.light_meshes.override_Od = True
material.light_meshes.Od = (0.5, 0.5, 0.5)
material.light_meshes.override_ks = True
material.light_meshes.ks = 0
mesh.materials.append(material)
plane = add(mesh)
sun = bpy.data.lights.new("Sun", 'SUN')
sun.light_meshes.softness = 'SCENE'  # by nodes, whose step the command tells
sun.energy, sun.angle = math.pi, 0
add(sun, location=(0, 0, 4))
scene.camera = add(bpy.data.cameras.new("Camera"), location=(0, 0, 10))
"""


def read(path):
    """Return an array (h, w, c) of float32, top row first."""
    file = oiio.ImageInput.open(str(path))
    assert file, f"{path}: {oiio.geterror()}"
    spec = file.spec()
    return np.asarray(file.read_image(oiio.FLOAT)).reshape(spec.height, spec.width, spec.nchannels)
