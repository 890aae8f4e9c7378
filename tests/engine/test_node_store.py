"""The store of node values gives the right values whatever is asked in whatever order, and it is small."""

import threading

import numpy as np
import pytest
from kept import drawn
from light_meshes.shadows.meshes.node_store import NodeStore, SharedNodesError
from scenes import hall

RANDOM = 7


def words(bits):
    """(n,L) booleans as (n,W)."""
    wide = np.zeros((len(bits), -(-bits.shape[1] // 64) * 64), np.uint8)
    wide[:, :bits.shape[1]] = bits
    return np.packbits(wide, axis=1, bitorder="little").view(np.uint64)


def within_a_minute(work, *args):
    """What work(*args) returns; a store that is wrong may wait for ever."""
    done = []
    thread = threading.Thread(target=lambda: done.append(work(*args)), daemon=True)
    thread.start()
    thread.join(60)
    assert done
    return done[0]


class Sky:
    """What lights each node sees, by a rule; counts how often it is asked."""

    def __init__(self, lights, channels=0):
        self.lights, self.channels = lights, channels
        self.traced: list[int] = []  # of each call; threads may append at once

    @property
    def asked(self):
        return sum(self.traced)

    def bits(self, nodes):
        n = nodes.astype(np.int64)
        mixed = n @ np.array([73856093, 19349663, 83492791]) % 1000003
        return (mixed[:, None] * (2 * np.arange(self.lights) + 1) >> 4) % 3 == 0

    def value(self, nodes):
        bits = self.bits(nodes)
        if not self.channels:
            return words(bits)
        return np.repeat(0.25 + bits, self.channels, axis=1) * np.tile(1 + np.arange(self.channels), self.lights)

    def trace(self, nodes, todo):
        asked = np.unpackbits(todo.view(np.uint8), axis=1, bitorder="little", count=self.lights).astype(bool)
        assert asked.any(1).all()
        self.traced.append(int(asked.sum()))
        value = self.value(nodes)
        return np.where(np.repeat(asked, self.channels, axis=1), value, 0) if self.channels else value & todo

    def check(self, store, nodes, need):
        """The store's values of what is needed are the rule's."""
        value = within_a_minute(store.values, nodes, words(need), self.trace)
        if self.channels:
            mask = np.repeat(need, self.channels, axis=1)
            np.testing.assert_array_equal(value[mask], self.value(nodes).astype(np.float32)[mask])
        else:
            np.testing.assert_array_equal(value & words(need), words(self.bits(nodes) & need))


def some_nodes(random, count, far):
    nodes = random.integers(-far, far, (2 * count, 3), endpoint=True).astype(np.int32)
    return random.permutation(np.unique(nodes, axis=0))[:count]


@pytest.mark.parametrize(("lights", "channels"), [(1, 0), (8, 0), (9, 0), (64, 0), (65, 0), (200, 0), (3, 1), (70, 3)])
def test_each_value_is_right_and_computed_once(lights, channels):
    """Near nodes meet again and again; far ones need the long keys, when near ones have their rows."""
    random, sky, store = np.random.default_rng(RANDOM), Sky(lights, channels), NodeStore(lights, channels)
    asked: dict[tuple[int, ...], np.ndarray] = {}
    for far in np.repeat([9, (1 << 20) - 1, 9, 2**31 - 1, 9], 3):
        nodes = some_nodes(random, 500, far)
        need = random.random((len(nodes), lights)) < random.random()
        need[::3] = True
        sky.check(store, nodes, need)
        for node, lit in zip(map(tuple, nodes.tolist()), need, strict=True):
            asked[node] = asked.get(node, False) | lit
    assert store.count == len(asked)
    assert sky.asked == sum(int(lit.sum()) for lit in asked.values())
    known = words(np.array([asked[node] for node in map(tuple, store.nodes.tolist())]))
    np.testing.assert_array_equal(store.known, known)
    every = np.array([*asked], np.int32)
    before = sky.asked
    sky.check(store, every, np.array([*asked.values()]))
    assert sky.asked == before


def test_corners_of_the_lattice_are_told_apart():
    """Keys of nodes that differ in one bit of one coordinate."""
    sky, store = Sky(5), NodeStore(5)
    first = np.array([[11, -7, 5]], np.int32)
    flips = np.unique(np.concatenate([first ^ np.where(np.arange(3) == axis, np.int32(1) << np.int32(bit), np.int32(0))
                                      for axis in range(3) for bit in range(32)] + [first]).astype(np.int32), axis=0)
    assert len(flips) == 97
    for nodes in (first, flips):
        sky.check(store, nodes, np.ones((len(nodes), 5), bool))
    assert sorted(map(tuple, store.nodes.tolist())) == sorted(map(tuple, flips.tolist()))
    assert sky.asked == 97 * 5


@pytest.mark.parametrize("channels", [0, 3])
def test_threads_share_the_work(channels):
    lights, sky, store, failed = 70, Sky(70, channels), NodeStore(70, channels), []
    nodes = some_nodes(np.random.default_rng(RANDOM), 3000, 1000)

    def work(seed):
        try:
            random = np.random.default_rng(seed)
            for _ in range(40):
                part = random.permutation(len(nodes))[:500]
                sky.check(store, nodes[part], random.random((500, lights)) < 0.3)
        except BaseException as e:
            failed.append(e)

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not failed and not any(thread.is_alive() for thread in threads)
    known = np.unpackbits(store.known.view(np.uint8)).sum()
    assert sky.asked == known


def test_who_waits_for_a_thread_that_fails_is_told_and_it_can_be_mended():
    sky, store, begun, fail = Sky(70), NodeStore(70), threading.Event(), threading.Event()
    nodes, need = np.arange(30, dtype=np.int32).reshape(-1, 3), np.ones((10, 70), bool)
    told = []

    def failing(nodes, todo):
        begun.set()
        assert fail.wait(60)
        raise ArithmeticError

    def run(trace):
        try:
            store.values(nodes, words(need), trace)
        except Exception as e:
            told.append(type(e))

    threads = [threading.Thread(target=run, args=(trace,)) for trace in (failing, sky.trace)]
    threads[0].start()
    assert begun.wait(60)
    threads[1].start()
    fail.set()
    for thread in threads:
        thread.join(60)
    assert sorted(t.__name__ for t in told) == [ArithmeticError.__name__, SharedNodesError.__name__] and not sky.asked
    store.mend()
    sky.check(store, nodes, need)
    assert sky.asked == need.sum()


@pytest.mark.parametrize("channels", [0, 1])
def test_lights_change_places_between_stores(channels):
    random, sky, old = np.random.default_rng(RANDOM), Sky(100, channels), NodeStore(100, channels)
    nodes = some_nodes(random, 2000, 50)
    need = random.random((len(nodes), 100)) < 0.5
    sky.check(old, nodes, need)
    order = np.append(random.permutation(100)[:70], -1).astype(np.int32)  # the last light is new
    gone = random.random(need.shape) < 0.2
    gone[::5] = True

    def forget(some, known):
        known &= ~words(gone)[[np.flatnonzero((nodes == node).all(1))[0] for node in some]]

    new = NodeStore(71, channels)
    new.inherit(old, order, forget)
    kept = np.zeros((len(nodes), 71), bool)
    kept[:, :70] = (need & ~gone)[:, order[:70]]
    assert new.count == kept.any(1).sum() < len(nodes)
    other = Sky(71, channels)
    other.bits = lambda nodes: np.where(order >= 0, sky.bits(nodes)[:, order], True)
    other.check(new, nodes, kept)
    assert other.asked == 0
    other.check(new, nodes, np.ones_like(kept))
    assert other.asked == (~kept).sum()


def test_sets_that_no_node_has_any_more_leave():
    """With each light every node has another set than before; few are in use at any time."""
    sky, store, random = Sky(256), NodeStore(256), np.random.default_rng(RANDOM)
    nodes = some_nodes(random, 300, 1000)
    for light in random.permutation(256):
        need = np.zeros((len(nodes), 256), bool)
        need[np.arange(len(nodes)), (light + np.arange(len(nodes)) % 7) % 256] = True
        sky.check(store, nodes, need)
    assert store.known.shape == (300, 4) and len(store._known.words) < 300
    assert sky.asked == 300 * 256


def test_more_sets_than_a_number_of_two_bytes_can_name():
    sky, store, random = Sky(64), NodeStore(64), np.random.default_rng(RANDOM)
    nodes = some_nodes(random, 70000, 1000)
    need = np.unpackbits(np.arange(1, 70001, dtype=np.uint64).view(np.uint8).reshape(-1, 8), axis=1, bitorder="little")
    sky.check(store, nodes, need.astype(bool))
    assert store._known.number.shape[1] == 3 and len(np.unique(store.known)) == 70000
    sky.check(store, nodes, np.ones_like(need, bool))
    np.testing.assert_array_equal(store.known, ~np.uint64(0))
    assert sky.asked == 70000 * 64


# --- Memory -------------------------------------------------------------------------------------------------

def arrays(thing, seen=None):
    """All arrays that something holds, however deep."""
    seen = {} if seen is None else seen
    if isinstance(thing, np.ndarray):
        seen[id(thing)] = thing
    elif isinstance(thing, tuple | list):
        for part in thing:
            arrays(part, seen)
    elif hasattr(thing, "__dict__"):
        arrays([*vars(thing).values()], seen)
    return [*seen.values()]


@pytest.mark.parametrize("lights", [1, 9, 17, 64, 256])
def test_bytes_a_node(lights):
    """At most 16, and a bit and a half a light."""
    _, ready = drawn(hall(lights, width=96, h=0.03), passes=("Combined",))
    store = ready.soft.store
    held = sum(a.nbytes for a in arrays(store))
    assert held == store.bytes
    assert held / store.count <= 16 + lights / 8 * 1.5
