"""Blender's light and shadow linking: which objects a light lights, and which block it.

The rules are Cycles': a collection that includes anything leaves all else out, one that only excludes takes all
else, an empty one says nothing. What stands in a nested collection has the state of the outermost one. An instance
has its instancer's state if any light links the instancer, else that of the object that it was made of.
"""

_COLLECTIONS = {"receivers": "receiver_collection", "blockers": "blocker_collection"}


def identity(ob) -> int:
    """What is the same for an object, its evaluated copies and its instances."""
    return ob.original.as_pointer()


def collections(ob) -> dict:
    """The collections that light object `ob` is linked with, by the engine's name for their purpose."""
    found = {what: getattr(ob.light_linking, name) for what, name in _COLLECTIONS.items()}
    return {what: collection.original for what, collection in found.items() if collection}


def link(lamps: list[dict], linked: list[dict], owners: list[tuple[int, int]]) -> None:
    """Give the engine's `lamps` their receivers and blockers: numbers of objects, left out where they are all.

    `linked` holds `collections` of each lamp; `owners` the identities of each of the snapshot's objects and of
    its instancer, or 0.
    """
    for what in _COLLECTIONS:
        states = {c: _states(c) for c in {own[what] for own in linked if what in own}}
        named = set().union(*states.values())
        own = [parent if parent in named else ob for ob, parent in owners]
        numbers = {}
        for collection, state in states.items():
            included = {ob for ob, how in state.items() if how == 'INCLUDE'}
            numbers[collection] = [i for i, ob in enumerate(own) if (ob in included if included else ob not in state)]
        for lamp, mine in zip(lamps, linked, strict=True):
            if what in mine and len(numbers[mine[what]]) < len(owners):
                lamp[what] = numbers[mine[what]]


def _states(collection) -> dict[int, str]:
    """Identity of each object in `collection` → INCLUDE or EXCLUDE. Of several the last counts, as in Blender."""
    states = {}
    for child, how in zip(collection.children, collection.collection_children, strict=True):
        states |= dict.fromkeys(map(identity, child.all_objects), how.light_linking.link_state)
    for ob, how in zip(collection.objects, collection.collection_objects, strict=True):
        states[identity(ob)] = how.light_linking.link_state
    return states
