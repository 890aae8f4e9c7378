"""The values of lattice nodes. Each is computed once, when it is needed; the store is compact, and threads and pictures
share it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...support.native import kernel, together
from .light_sets import light_sets
from .node_keys import keys

BLOCK = 1 << 16  # the number of rows that are moved from one store to another at a time


_claim, _put, _learn = kernel("store_claim"), kernel("store_put"), kernel("store_learn")
_settled, _gather = kernel("store_settled"), kernel("store_gather")
_drop_begun, _moved_bits = kernel("store_drop_begun"), kernel("store_moved_bits")


class SharedNodesError(RuntimeError):
    """Another thread failed or was cancelled while it computed nodes for which this thread waits."""


class NodeStore:
    """Node values v(i,x): bits if the scene is opaque, otherwise `channels` (1 or 3) float32 for each light.

    Each value is computed once, when it is first needed. Threads share the store: a thread that needs a value which
    another one is computing waits for it.

    A row is a node. It has a value, and the set of lights for which the value is known. For a light that is not known,
    the bit of the value says whether some thread is computing it. (If values are numbers, there are such bits beside
    them.)
    """

    def __init__(self, lights: int, channels: int = 0, kind: type = np.float32) -> None:
        self._lights, self._channels = lights, channels
        self.words = (lights + 63) // 64
        self.count = 0
        self.largest = 0  # the most nodes that one picture has added
        self._before = 0  # the nodes that were there when this picture began
        self._ready = threading.Condition()
        self._broken = False
        self._keys = keys()
        self._known = light_sets(np.zeros((1, self.words), np.uint64), np.zeros((0, 1), np.uint8))
        self._bits = np.zeros((0, (lights + 7) // 8), np.uint8)
        self._numbers: NDArray = np.zeros((0, lights * channels), kind)

    @property
    def bytes(self) -> int:
        """Return the memory of the store in bytes."""
        return self._keys.bytes + self._known.bytes + self._bits.nbytes + self._numbers.nbytes

    @property
    def bytes_of_a_node(self) -> float:
        """Return the memory of a node's values."""
        return self._lights / 8 + self._numbers.shape[1] * self._numbers.itemsize

    @property
    def nodes(self) -> NDArray[np.int32]:
        """Return the nodes (count,3) that have a row."""
        return self._keys.nodes(0, self.count)

    @property
    def known(self) -> NDArray[np.uint64]:
        """Return for each node the lights (count,W) for which its value is known."""
        return self._known.of(0, self.count)

    def end_picture(self) -> None:
        """Take notice of how many nodes the picture has added; what is asked for from now on is another one's."""
        self.largest = max(self.largest, self.count - self._before)
        self._before = self.count

    def mend(self) -> None:
        """Forget all values that a render had begun to compute when it was cancelled or failed."""
        self._broken = False
        _drop_begun(self._bits, self._known.words, self._known.number, self.count)

    def inherit(self, old: NodeStore, source: NDArray[np.int32],
                forget: Callable[[NDArray[np.int32], NDArray[np.uint64]], None]) -> None:
        """Take over the values of `old` that are still valid, into an empty store of the same kind.

        Light i is light source[i] of the old store; −1 if it is new. forget(nodes, known) must clear the bits (n,V) of
        values that are no longer valid.
        """
        for first in range(0, old.count, BLOCK):
            last = min(first + BLOCK, old.count)
            nodes, known = old._keys.nodes(first, last), old._known.of(first, last)
            forget(nodes, known)
            kept = np.zeros((last - first, self.words), np.uint64)
            _moved_bits(known, source, kept)
            some = np.flatnonzero(kept.any(1))
            value = old._value(np.arange(first, last, dtype=np.uint32)[some])
            self.values(nodes[some], kept[some], partial(self._moved, value, source))
        self._before = self.count

    def _moved(self, value: NDArray, source: NDArray[np.int32], _: NDArray, kept: NDArray[np.uint64]) -> NDArray:
        """Return values of another store for the lights in `kept` (n,W)."""
        if not self._channels:
            bits = np.zeros_like(kept)
            _moved_bits(value, source, bits)
            return bits & kept
        mask = np.unpackbits(kept.view(np.uint8), axis=1, count=self._lights, bitorder="little").astype(np.bool_)
        numbers = value.reshape(len(value), -1, self._channels)[:, source]
        numbers[~mask] = 0
        return numbers.reshape(len(value), -1)

    def values(
        self, nodes: NDArray[np.int32], need: NDArray[np.uint64],
        evaluate: Callable[[NDArray[np.int32], NDArray[np.uint64]], NDArray],
    ) -> NDArray:
        """Return the values (n, words), or (n, lights·channels), of distinct `nodes` (n,3), which are right for the
        lights in `need`.

        evaluate(nodes, todo) traces the missing values, with 0 elsewhere; it is called outside of the lock. need, todo:
        (n, words).
        """
        rows, wanted, todo = np.empty(len(nodes), np.uint32), np.empty(len(nodes), np.int64), np.empty_like(need)
        try:
            with self._ready:
                settled, begun = self._claim(nodes, need, rows, wanted, todo)
                if settled:
                    return self._value(rows)
            wanted, todo = wanted[:begun], todo[:begun]
            found = evaluate(nodes.take(wanted, axis=0), todo) if begun else None
            with self._ready:
                value = None
                if found is not None:
                    value = self._settle(rows, need, rows.take(wanted), todo, found)
                    self._ready.notify_all()
                while value is None and not _settled(self._known.words, self._known.number, rows, need):
                    if self._broken:
                        raise SharedNodesError
                    self._ready.wait()
                return self._value(rows) if value is None else value
        except BaseException:
            with self._ready:
                self._broken = True  # otherwise threads that wait for these nodes would wait for ever
                self._ready.notify_all()
            raise

    def _value(self, rows: NDArray[np.uint32]) -> NDArray:
        if self._channels:
            value: NDArray = self._numbers[rows]
            return value
        out = np.zeros((len(rows), self.words), np.uint64)
        _gather(self._bits, rows, out.view(np.uint8))
        return out

    def _claim(self, nodes: NDArray[np.int32], need: NDArray[np.uint64], rows: NDArray[np.uint32],
               wanted: NDArray[np.int64], todo: NDArray[np.uint64]) -> tuple[bool, int]:
        """Fill the rows of `nodes` (new ones are appended); and wanted and todo: which nodes have lights that no thread
        has begun yet, and these.

        Returns whether everything that is needed is known, and how many are wanted.
        """
        state = np.array([0, self.count, 1, 0], np.int64)
        while True:
            room = min(self._keys.room, len(self._bits))
            k, known = self._keys, self._known
            _claim(*k, known.words, known.number, self._bits, room, nodes, need, state, rows, wanted, todo)
            done, self.count, settled, begun = state.tolist()
            if done == len(nodes):
                return bool(settled), begun
            if self.count < room:
                self._keys = self._keys.widened()
                continue
            if self.count == 0:
                self._keys.base[:] = nodes[0].astype(np.int64) - (1 << 20)
            self._keys = self._keys.roomier(self.count, len(nodes) - done)
            new = len(self._keys.near)
            if new > len(self._bits):
                self._known.resize(new)
                self._numbers.resize((new, self._numbers.shape[1]), refcheck=False)
                self._bits.resize((new, self._bits.shape[1]), refcheck=False)

    def _settle(self, rows: NDArray[np.uint32], need: NDArray[np.uint64], own: NDArray[np.uint32],
                todo: NDArray[np.uint64], found: NDArray) -> NDArray | None:
        """Store the values `found`: from now on the rows `own` know the lights in `todo`.

        Return `values` of all rows, or None if other threads are still computing some; also for other reasons.
        """
        value, lights = None, np.empty(self.words, np.uint64)
        if self._channels:
            # each value is found once, and was 0 before
            self._numbers[own] += found.astype(self._numbers.dtype, copy=False)
            done = self._learn(own, todo, lights, 0)
        else:
            k, out = self._known, np.zeros((len(rows), self.words), np.uint64)
            _, done, settled, _ = together(
                (_put, self._bits, own, todo.view(np.uint8), found.view(np.uint8)),
                (_learn, k.words, k.size, k.table, k.number, own, todo, lights, 0),
                (_settled, k.words, k.number, rows, need), (_gather, self._bits, rows, out.view(np.uint8)))
            value = out if settled and done == len(own) else None
        while done < len(own):  # there are more different sets of lights than there is room for
            self._known = self._known.renewed()
            done = self._learn(own, todo, lights, done)
        return value

    def _learn(self, rows: NDArray[np.uint32], todo: NDArray[np.uint64], lights: NDArray[np.uint64], done: int) -> int:
        """Note from row `done` on that these rows know the lights in `todo`; return how many are done."""
        k = self._known
        return _learn(k.words, k.size, k.table, k.number, rows, todo, lights, done)
