"""Material, light and world previews: scenes of Blender's own, about one unit large, in a small picture."""

# Soft edges that suit the area lights of these scenes, and few nodes: an artist waits for every preview.
SETTINGS = {"auto_h": False, "h": 0.03, "kI": 2.0, "samples": 4}
_FLOORS = {"Floor", "FloorHidden"}
_FLOOR_COLOR = [0.083] * 3


def adapt(objects: list[dict], materials: list[dict]) -> None:
    """Say what the floor's nodes say: its colour is a checker's, here the mean of it; icons hide it from the camera."""
    for material in materials:
        if material["name"] in _FLOORS:
            material["Od"] = _FLOOR_COLOR
    if any(material["name"] == "FloorHidden" for material in materials):
        for ob in objects:
            ob["visible_camera"] &= ob["name"] != "Floor"
