"""Blender's light and shadow linking: which objects a light lights, and which block it.

The rules are Cycles': a collection that includes anything leaves all else out, one that only excludes takes all
else, an empty one says nothing. What stands in a nested collection has the state of the outermost one. An instance
has its instancer's state if any light links the instancer, else that of the object that it was made of.
"""

_COLLECTIONS = {"receivers": "receiver_collection", "blockers": "blocker_collection"}


def identity(block) -> int:
    """What is the same for an object or collection, its evaluated copies and its instances."""
    return block.original.as_pointer()


class Links:
    """Collects what lights are linked with. Holds nothing of Blender's."""

    def __init__(self) -> None:
        self._states: dict[int, dict[int, str]] = {}  # of each collection
        self._lamps: list[dict[str, int]] = []  # collections of each light, by what they are for

    def add(self, ob) -> None:
        """Add light object `ob`."""
        mine = {}
        for what, name in _COLLECTIONS.items():
            collection = getattr(ob.light_linking, name)
            if collection:
                mine[what] = identity(collection)
                if mine[what] not in self._states:
                    self._states[mine[what]] = _states(collection.original)
        self._lamps.append(mine)

    def link(self, lamps: list[dict], owners: list[tuple[int, int]]) -> None:
        """Give the engine's `lamps` their receivers and blockers: numbers of objects, left out where they are all.

        `lamps` are in the order in which they were added; `owners` are the identities of each of the snapshot's
        objects and of its instancer, or 0.
        """
        for what in _COLLECTIONS:
            states = {mine[what]: self._states[mine[what]] for mine in self._lamps if what in mine}
            named = set().union(*states.values())
            own = [parent if parent in named else ob for ob, parent in owners]
            numbers = {}
            for collection, state in states.items():
                included = {ob for ob, how in state.items() if how == 'INCLUDE'}
                numbers[collection] = [
                    i for i, ob in enumerate(own) if (ob in included if included else ob not in state)]
            for lamp, mine in zip(lamps, self._lamps, strict=True):
                if what in mine and len(numbers[mine[what]]) < len(owners):
                    lamp[what] = numbers[mine[what]]


def _states(collection) -> dict[int, str]:
    """Identity of each object in `collection` → INCLUDE or EXCLUDE. Of several the last counts, as in Blender."""
    states: dict[int, str] = {}
    for child, how in zip(collection.children, collection.collection_children, strict=True):
        states |= dict.fromkeys(map(identity, child.all_objects), how.light_linking.link_state)
    for ob, how in zip(collection.objects, collection.collection_objects, strict=True):
        states[identity(ob)] = how.light_linking.link_state
    return states
