"""Material, light and world previews: Blender's own scenes, about one unit large, in a small picture."""

# Soft edges that suit the area lights of these scenes, with few nodes, because the artist waits for every preview.
SETTINGS = {"auto_h": False, "h": 0.03, "kI": 2.0, "samples": 4}
_FLOORS = {"Floor", "FloorHidden"}
_FLOOR_COLOR = [0.083] * 3


def adapt(objects: list[dict], materials: list[dict], lights: list[dict]) -> None:
    """Set the colour of the floor. Its nodes make a checker pattern, for which the mean colour is used here; icons hide
    the floor from the camera. Shadows have one width, which is faster.
    """
    for light in lights:
        light["softness"] = 'SCENE'
    for material in materials:
        if material["name"] in _FLOORS:
            material["Od"] = _FLOOR_COLOR
            material.pop("program", None)
    if any(material["name"] == "FloorHidden" for material in materials):
        for ob in objects:
            ob["visible_camera"] &= ob["name"] != "Floor"
