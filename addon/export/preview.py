"""Material, light and world previews: Blender's own scenes, about one unit large, in a small picture.

The artist waits for every preview, so they leave out what takes long and is hardly seen there. As in Cycles, where
Blender's scenes ask for it, no light goes on from surface to surface. The preview's world, which is nearly black,
lights all sides alike.
"""

# Soft edges that suit the area lights of these scenes, with few nodes; few rays for rough reflections.
SETTINGS = {"auto_h": False, "h": 0.03, "kI": 2.0, "samples": 4, "bounces": 0, "reflection_rays": 16, "cutoff": 0.01,
            "clamp_indirect": 0.0}
DIM = 0.1  # a world up to this radiance is a preview's own; a scene's world, which may be shown instead, is brighter


def adapt(description: dict) -> None:
    """Change what is exported. In icons, where Blender shows the object alone, the floor is hidden from the camera.
    Where light comes through surfaces other than clear glass, shadows have one width, which is several times faster.
    """
    materials = description["materials"]
    icon = [material for material in materials if material["name"] == "FloorHidden"]
    for material in icon:  # it is hidden by nodes, which would cost each ray that meets it
        material["alpha"] = 1.0
        material.get("program", {}).get("values", {}).pop("alpha", None)
    if icon:
        for ob in description["objects"]:
            ob["visible_camera"] &= ob["name"] != "Floor"
    if any(map(_veils, materials)):
        for light in description["lights"]:
            light["softness"] = 'SCENE'
    if "world" not in description and max(description["world_color"]) <= DIM:
        description["settings"]["world_light"] = 'AMBIENT'


def _veils(material: dict) -> bool:
    """Return whether light comes through a material in part, or scattered."""
    varies = material.get("program", {}).get("values", {})
    return material["alpha"] < 1 or material.get("frosted", 0) > 0 or not varies.keys().isdisjoint({"alpha", "frosted"})
