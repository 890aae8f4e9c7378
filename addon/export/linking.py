"""Blender's light and shadow linking: which objects a light lights, and which objects block it.

The rules are those of Cycles. A collection that includes anything excludes everything else. A collection that only
excludes includes everything else. An empty collection has no effect. The contents of a nested collection have the state
of the outermost one. An instance has the state of its instancer if any light links the instancer; otherwise that of the
object from which it was made.
"""

_COLLECTIONS = {"receivers": "receiver_collection", "blockers": "blocker_collection"}


def identity(block) -> int:
    """Return a number that is the same for an object or collection, its evaluated copies and its instances."""
    return block.original.as_pointer()


class Links:
    """Collects the links of lights. It holds no Blender data."""

    def __init__(self) -> None:
        self._states: dict[int, dict[int, str]] = {}  # for each collection
        self._lamps: list[dict[str, int]] = []  # the collections of each light, by their purpose,
        self._objects: list[dict[str, int]] = []  # and of each other object, whose surfaces may give light

    def add(self, ob) -> None:
        """Add light object `ob`."""
        self._lamps.append(self._of(ob))

    def add_object(self, ob, parent) -> None:
        """Add another object, and its instancer or None."""
        self._objects.append(self._of(ob) or (self._of(parent) if parent else {}))

    def _of(self, ob) -> dict[str, int]:
        mine = {}
        for what, name in _COLLECTIONS.items():
            collection = getattr(ob.light_linking, name)
            if collection:
                mine[what] = identity(collection)
                if mine[what] not in self._states:
                    self._states[mine[what]] = _states(collection.original)
        return mine

    def link(self, lamps: list[dict], objects: list[dict], owners: list[tuple[int, int]]) -> None:
        """Add receivers and blockers to the engine's `lamps` and `objects`, as lists of object numbers. A list is left
        out if it holds all objects.

        Both are in the order in which they were added; `owners` are the identities of each object of the snapshot
        and of its instancer, or 0.
        """
        for what in _COLLECTIONS:
            every = self._lamps + self._objects
            states = {mine[what]: self._states[mine[what]] for mine in every if what in mine}
            named = set().union(*states.values())
            own = [parent if parent in named else ob for ob, parent in owners]
            numbers = {}
            for collection, state in states.items():
                included = {ob for ob, how in state.items() if how == 'INCLUDE'}
                numbers[collection] = [
                    i for i, ob in enumerate(own) if (ob in included if included else ob not in state)]
            for entry, mine in zip([*lamps, *objects], every, strict=True):
                if what in mine and len(numbers[mine[what]]) < len(owners):
                    entry[what] = numbers[mine[what]]


def _states(collection) -> dict[int, str]:
    """Return identity of each object in `collection` → INCLUDE or EXCLUDE. If an object occurs several times the last
    state counts, as in Blender.
    """
    states: dict[int, str] = {}
    for child, how in zip(collection.children, collection.collection_children, strict=True):
        states |= dict.fromkeys(map(identity, child.all_objects), how.light_linking.link_state)
    for ob, how in zip(collection.objects, collection.collection_objects, strict=True):
        states[identity(ob)] = how.light_linking.link_state
    return states
