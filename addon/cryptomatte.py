"""Cryptomatte: compute the numbers of names, and the metadata that a compositor reads in the picture's file."""

import json

import bpy

KINDS = ("CryptoObject", "CryptoMaterial", "CryptoAsset")
SWITCHES = {"CryptoObject": "use_pass_cryptomatte_object", "CryptoMaterial": "use_pass_cryptomatte_material",
            "CryptoAsset": "use_pass_cryptomatte_asset"}
DEFAULT = "default"  # our name for the material of objects that have none
UNNAMED = "default_surface"  # Cycles' name for it


def wanted(view_layer) -> list[str]:
    """Return the kinds of Cryptomatte (object, material, asset) that the view layer asks for."""
    return [kind for kind in KINDS if getattr(view_layer, SWITCHES[kind])]


def levels(view_layer) -> int:
    """Return how many passes each kind has; each pass holds two ids."""
    return (min(16, view_layer.pass_cryptomatte_depth) + 1) // 2


def number(name: str) -> int:
    """Return the MurmurHash3 (x86, 32 bits, seed 0) of a name."""
    data = name.encode("utf-8", "surrogateescape")
    whole = len(data) - len(data) % 4
    h = 0
    for i in range(0, whole, 4):
        h ^= _mixed(int.from_bytes(data[i:i + 4], "little"))
        h = (_rotated(h, 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    h ^= _mixed(int.from_bytes(data[whole:], "little"))
    h ^= len(data)
    h = (h ^ h >> 16) * 0x85EBCA6B & 0xFFFFFFFF
    h = (h ^ h >> 13) * 0xC2B2AE35 & 0xFFFFFFFF
    return h ^ h >> 16


def _rotated(x: int, by: int) -> int:
    return (x << by | x >> 32 - by) & 0xFFFFFFFF


def _mixed(k: int) -> int:
    return _rotated(k * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF


def asset(ob) -> str:
    """Return the name of the topmost parent of `ob`, or its own name if it has no parent."""
    while ob.parent:
        ob = ob.parent
    return ob.name


def add_numbers(description: dict, view_layer) -> dict[str, set[str]]:
    """Add the Cryptomatte numbers to objects and materials of a snapshot's `description`; return the names of each
    wanted kind.
    """
    kinds = wanted(view_layer)
    if not kinds:
        return {}
    names: dict[str, set[str]] = {kind: set() for kind in KINDS}
    for ob in description["objects"]:
        found = bpy.data.objects.get(ob["name"])
        of_asset = asset(found) if found else ob["name"]
        ob |= {"cryptomatte": number(ob["name"]), "cryptomatte_asset": number(of_asset)}
        names["CryptoObject"].add(ob["name"])
        names["CryptoAsset"].add(of_asset)
    for n, material in enumerate(description["materials"]):
        name = UNNAMED if material["name"] == DEFAULT else material["name"]
        description["materials"][n] = material | {"cryptomatte": number(name)}
        names["CryptoMaterial"].add(name)
    return {kind: names[kind] for kind in kinds}


def metadata(view_layer_name: str, names: dict[str, set[str]]) -> dict[str, str]:
    """Return field → value for the names of each kind, as in the Cryptomatte specification."""
    fields: dict[str, str] = {}
    for kind, of_kind in names.items():
        layer = f"{view_layer_name}.{kind}"
        prefix = f"cryptomatte/{number(layer):08x}"[:len("cryptomatte/") + 7]
        manifest = {name: f"{number(name):08x}" for name in sorted(of_kind)}
        fields |= {f"{prefix}/name": layer, f"{prefix}/hash": "MurmurHash3_32",
                   f"{prefix}/conversion": "uint32_to_float32",
                   f"{prefix}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))}
    return fields
