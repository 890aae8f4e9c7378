"""Channels: the values of meshes and instances for which programs of materials ask: attributes, UV maps, tangents;
random numbers, colours and properties of objects.

A channel is one number at each corner of each triangle, or of each instance. It keeps its number for the session, so
that meshes which are not read again keep theirs.
"""

from __future__ import annotations

from typing import Any

from . import values as v
from .values import Value

Key = tuple[Any, ...]


class Channels:
    """The numbers of channels."""

    def __init__(self) -> None:
        self.corners: dict[Key, int] = {}
        self.instances: dict[Key, int] = {}


class Asked:
    """The values for which one material's nodes ask."""

    def __init__(self, channels: Channels | None = None) -> None:
        self._channels = channels or Channels()
        self.corners: set[Key] = set()
        self.instances: set[Key] = set()

    def corner(self, *key: Any) -> Value:
        """Return a channel of a mesh: ("attribute", "color" or "uv", name, component), or ("tangent", UV map,
        component).

        Components of attributes: 0 to 2 the colour or vector, 3 alpha, 4 the number that stands for all.
        """
        self.corners.add(key)
        return v.operation("attribute", float(self._channels.corners.setdefault(key, len(self._channels.corners))))

    def instance(self, *key: Any) -> Value:
        """Return the channel of instances, see `instance_value`."""
        self.instances.add(key)
        return v.operation("instance", float(self._channels.instances.setdefault(key, len(self._channels.instances))))


class Elsewhere(Asked):
    """The values for what is no surface, a world or a lamp: no mesh has any there."""

    def __init__(self, depsgraph: Any) -> None:
        super().__init__()
        self._depsgraph = depsgraph

    def corner(self, *key: Any) -> Value:
        """Return what an attribute has that does not exist."""
        return float(key[0] == "attribute" and key[2] == 3)

    def instance(self, *key: Any) -> Value:
        """Return a number of the view layer, or what an object has that does not exist."""
        if key[0] != "property":
            return 0.0
        _, kind, _, component = key
        return instance_value(key, None, None, None, self._depsgraph) if kind == 'VIEW_LAYER' else float(component == 3)


def instance_value(key: Key, instance: Any, ob: Any, source: Any, depsgraph: Any) -> float:
    """Return the value of a channel for an instance of `ob`."""
    what, *rest = key
    if what == "random":
        return _random(instance, source)
    if what == "index":
        return float(ob.pass_index)
    if what == "color":
        return float(ob.color[rest[0]])
    if what == "instancer":  # the place on what it is an instance of; 0 for what is none
        name, component = rest
        if not instance.is_instance:
            return 0.0
        return float(instance.uv[component] if name == "uv" else 0.5 * instance.orco[component] - 0.5)
    kind, name, component = rest  # "property"
    if kind == 'VIEW_LAYER':
        owners = [depsgraph.view_layer_eval, depsgraph.scene_eval, depsgraph.scene_eval.world]
    else:
        parent = instance.parent if kind == 'INSTANCER' else None
        owner = parent or ob
        owners = [owner, owner.data]
    return _component(_property(owners, name), component)


def _random(instance: Any, source: Any) -> float:
    """Return Cycles' random number of an instance, from 0 to 1."""
    if instance.is_instance:
        word = instance.random_id & 0xFFFFFFFF
    else:
        word = 0
        for byte in source.name.encode():
            word = (word * 37 + byte) & 0xFFFFFFFF
        word = jenkins(word, 0)
    return word / 0xFFFFFFFF


def jenkins(*numbers: int) -> int:
    """Return Bob Jenkins' hash (lookup3) of one word or two."""
    c = 0xdeadbeef + (len(numbers) << 2) + 13
    words = [(c + x) & 0xFFFFFFFF for x in (*numbers, 0, 0)[:3]]
    for i, j, k in (2, 1, 14), (0, 2, 11), (1, 0, 25), (2, 1, 16), (0, 2, 4), (1, 0, 14), (2, 1, 24):
        turned = (words[j] << k | words[j] >> (32 - k)) & 0xFFFFFFFF
        words[i] = ((words[i] ^ words[j]) - turned) & 0xFFFFFFFF
    return words[2]


def _property(owners: list[Any], name: str) -> Any:
    """Return the first property of that name: a custom one, or one of Blender's; None: there is none."""
    for owner in owners:
        if owner is None:
            continue
        if name in owner.keys():  # noqa: SIM118 (IDs are no dictionaries)
            return owner[name]
        try:
            return owner.path_resolve(name)
        except (ValueError, TypeError):
            continue
    return None


def _component(value: Any, component: int) -> float:
    """Return a number of a property: of its colour (0 to 2), its alpha (3), or what stands for all (4); 0 if it is
    none.
    """
    if isinstance(value, bool | int | float):
        return 1.0 if component == 3 else float(value)
    try:
        numbers = [float(x) for x in value][:4]
    except (TypeError, ValueError):
        return 0.0
    numbers += [0.0] * (3 - len(numbers)) + [1.0] * (len(numbers) < 4)
    return sum(numbers[:3]) / 3 if component == 4 else numbers[component]
