"""Ask Blender, in any of its versions, to write float EXR files."""


def write_floats(scene, path, color_mode='RGB'):
    """Let the scene write its picture as one layer of 32-bit floats to `path`."""
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'IMAGE'  # 5.0+
    image.file_format, image.color_depth, image.color_mode = 'OPEN_EXR', '32', color_mode
    scene.render.filepath = str(path)


def write_layers(scene, path):
    """Let the scene write all passes as 32-bit floats, in one part, to `path`."""
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = 'MULTI_LAYER_IMAGE'  # 5.0+
    image.file_format, image.color_depth = 'OPEN_EXR_MULTILAYER', '32'
    if hasattr(image, "use_exr_interleave"):
        image.use_exr_interleave = True
    scene.render.filepath = str(path)
