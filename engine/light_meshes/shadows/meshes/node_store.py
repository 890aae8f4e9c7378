"""The values of lattice nodes: computed on demand, once, in little memory, and shared by threads and pictures."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...support.native import kernel
from .light_sets import light_sets
from .node_keys import keys

BLOCK = 1 << 16  # rows that pass from one store to another at once


_claim, _put, _learn = kernel("store_claim"), kernel("store_put"), kernel("store_learn")
_settled, _gather = kernel("store_settled"), kernel("store_gather")
_drop_begun, _moved_bits = kernel("store_drop_begun"), kernel("store_moved_bits")


class SharedNodesError(RuntimeError):
    """Another thread failed, or was cancelled, while it computed nodes that this one waits for."""


class NodeStore:
    """Node values v(i,x): bits where the scene is opaque, else `channels` (1 or 3) float32 a light.

    Each is computed once, when first needed. Threads share it: one that needs a value which another is computing
    waits for it.

    A row is a node. Beside its value it has the set of lights that are known there. A bit of a light that is not known
    says whether somebody is computing it. (Numbers have such bits too, beside them.)
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
        """Memory of the store."""
        return self._keys.bytes + self._known.bytes + self._bits.nbytes + self._numbers.nbytes

    @property
    def nodes(self) -> NDArray[np.int32]:
        """The nodes (count,3) that have a row."""
        return self._keys.nodes(0, self.count)

    @property
    def known(self) -> NDArray[np.uint64]:
        """The lights (count,W) of which each has its value."""
        return self._known.of(0, self.count)

    def end_picture(self) -> None:
        """Take notice of how many nodes the picture has added; what is asked for from now on is another one's."""
        self.largest = max(self.largest, self.count - self._before)
        self._before = self.count

    def mend(self) -> None:
        """Be as if what was begun when a render was cancelled, or failed, had never been asked for."""
        self._broken = False
        _drop_begun(self._bits, self._known.words, self._known.number, self.count)

    def inherit(self, old: NodeStore, source: NDArray[np.int32],
                forget: Callable[[NDArray[np.int32], NDArray[np.uint64]], None]) -> None:
        """Take over, into an empty store of the same kind, the values of `old` that are still right.

        Light i is light source[i] there; −1: it is new. forget(nodes, known) clears the bits (n,V) of those that are
        wrong by now.
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
        """Values of another store, for the lights in `kept` (n,W)."""
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
        """Values (n, words), or (n, lights·channels), of distinct `nodes` (n,3), right for the lights in `need`.

        evaluate(nodes, todo) traces the missing ones, 0 elsewhere; it runs outside the lock. need, todo: (n, words).
        """
        rows, todo = np.empty(len(nodes), np.uint32), np.empty_like(need)
        try:
            with self._ready:
                if self._claim(nodes, need, rows, todo):
                    return self._value(rows)
            wanted = np.flatnonzero(todo.any(1))
            todo = todo[wanted]
            found = evaluate(nodes[wanted], todo) if len(wanted) else None
            with self._ready:
                if found is not None:
                    self._settle(rows[wanted], todo, found)
                    self._ready.notify_all()
                while not _settled(self._known.words, self._known.number, rows, need):
                    if self._broken:
                        raise SharedNodesError
                    self._ready.wait()
                return self._value(rows)
        except BaseException:
            with self._ready:
                self._broken = True  # whoever waits for these nodes would wait for ever
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
               todo: NDArray[np.uint64]) -> bool:
        """Fill the rows of `nodes`, new ones appended, and todo: the lights that nobody has asked for yet.

        Returns whether all that is needed is known.
        """
        state = np.array([0, self.count, 1], np.int64)
        while True:
            room = min(self._keys.room, len(self._bits))
            k, known = self._keys, self._known
            _claim(*k, known.words, known.number, self._bits, room, nodes, need, state, rows, todo)
            done, self.count, settled = state.tolist()
            if done == len(nodes):
                return bool(settled)
            if self.count < room:
                self._keys = self._keys.widened()
                continue
            if self.count == 0:
                self._keys.base[:] = nodes[0].astype(np.int64) - (1 << 20)
            self._keys = self._keys.roomier(self.count)
            new = len(self._keys.near)
            if new > len(self._bits):
                self._known.resize(new)
                self._numbers.resize((new, self._numbers.shape[1]), refcheck=False)
                self._bits.resize((new, self._bits.shape[1]), refcheck=False)

    def _settle(self, rows: NDArray[np.uint32], todo: NDArray[np.uint64], found: NDArray) -> None:
        """Now these rows know the lights in `todo`."""
        if self._channels:
            self._numbers[rows] += found.astype(self._numbers.dtype, copy=False)  # each is found once, and was 0
        else:
            _put(self._bits, rows, todo.view(np.uint8), found.view(np.uint8))
        done, lights = 0, np.empty(self.words, np.uint64)
        while True:
            k = self._known
            done = _learn(k.words, k.size, k.table, k.number, rows, todo, lights, done)
            if done == len(rows):
                return
            self._known = self._known.renewed()
