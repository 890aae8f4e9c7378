"""What Blender is asked to write, in any of its versions: float EXR files."""


def write_floats(scene, path, color_mode='RGB'):
    """The scene's pictures become one layer of 32-bit floats at `path`."""
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'IMAGE'  # 5.0+
    image.file_format, image.color_depth, image.color_mode = 'OPEN_EXR', '32', color_mode
    scene.render.filepath = str(path)


def write_layers(scene, path):
    """The scene's pictures become all passes in 32-bit floats, in one part, at `path`."""
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'MULTI_LAYER_IMAGE'  # 5.0+
    image.file_format, image.color_depth = 'OPEN_EXR_MULTILAYER', '32'
    if hasattr(image, "use_exr_interleave"):
        image.use_exr_interleave = True
    scene.render.filepath = str(path)
