"""Material, light and world previews: Blender's own scenes, about one unit large, in a small picture."""

# Soft edges that suit the area lights of these scenes, with few nodes, because the artist waits for every preview.
SETTINGS = {"auto_h": False, "h": 0.03, "kI": 2.0, "samples": 4}


def adapt(objects: list[dict], materials: list[dict], lights: list[dict]) -> None:
    """Hide the floor from the camera in icons, where Blender shows the object alone. Shadows have one width, which is
    faster.
    """
    for light in lights:
        light["softness"] = 'SCENE'
    if any(material["name"] == "FloorHidden" for material in materials):
        for ob in objects:
            ob["visible_camera"] &= ob["name"] != "Floor"
