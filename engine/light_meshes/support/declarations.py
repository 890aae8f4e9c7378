"""What kernels declare of their arguments (native.h): names, types and lengths, and conditions such as `W=words(L)` or
`0<=row<n`. The build makes C of both, so that a call is checked in nanoseconds.

The build and the engine use this module, so it imports nothing from the package.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

_ARGUMENT = re.compile(r"(\w+) (\w+)(?:\[([\w,]+)\])?([!?]*)")
_LITERAL = re.compile(r'"([^"]*)"')
_DECLARED = re.compile(r'const char (\w+)_takes\[\] = ((?:"[^"]*"\s*)*);')
_MEMBERS = {"i64": "integer", "u64": "whole", "f64": "real"}
_FUNCTIONS = ("words", "power", "rising", "tree", "inf")  # of calls.h, and infinity


class Argument(NamedTuple):
    """One argument as it is written. lengths: of its axes, letters or numbers; empty: it is a number."""

    name: str
    kind: str
    lengths: tuple[str, ...]
    marks: str


class Declared(NamedTuple):
    """What the text of a kernel says. lengths: the letters, in order. late: of the conditions, those from there on
    are left out by fast calls.
    """

    lengths: tuple[str, ...]
    arguments: tuple[Argument, ...]
    conditions: tuple[str, ...]
    late: int


def declared(text: str) -> Declared:
    """Parse the text of a kernel."""
    first, quick, late, *_ = [*text.split(";"), "", ""]
    arguments = tuple(Argument(name, kind, tuple(shape.split(",")) if shape else (), marks)
                      for name, kind, shape, marks in _ARGUMENT.findall(first))
    letters = dict.fromkeys(a for argument in arguments for a in argument.lengths if not a.isdigit())
    return Declared(tuple(letters), arguments, (*quick.split(), *late.split()), len(quick.split()))


def names(condition: str) -> list[str]:
    """Return the lengths and arguments that a condition is about, each once, in order."""
    words = dict.fromkeys(re.findall(r"[A-Za-z_]\w*", condition))
    return [word for word in words if word not in _FUNCTIONS]


def calls(expanded: str) -> str:
    """Return a C source with a function for each kernel that takes its arguments as an array (calls.h), and one that
    tells which of its conditions are broken.

    expanded: what a C preprocessor makes of `sources.included`.
    """
    lines = ['#include "calls.h"']
    for name, text in _DECLARED.findall(expanded):
        of = declared("".join(_LITERAL.findall(text)))
        kinds = ["i64"] * len(of.lengths) + ["const void *" if a.lengths else a.kind for a in of.arguments]
        passed = ", ".join(f"s[{n}].{_MEMBERS.get(kind, 'place')}" for n, kind in enumerate(kinds))
        lines += [f"i64 {name}({', '.join(kinds) or 'void'});",
                  f"EXPORT i64 {name}_slots(const Slot *s) {{ (void)s; return {name}({passed}); }}"]
        if of.conditions:
            lines.append(_broken(name, of))
    return "\n".join(lines) + "\n"


def _broken(name: str, of: Declared) -> str:
    """Return a C function that tells which of the conditions whose bits are set in `asked` is the first that is
    broken, counted from 1; 0: none.
    """
    tests = [f"    if ({' && '.join([f'asked >> {k} & 1', *_given(condition, of)])}) {{\n"
             + "".join(f"        {line}\n" for line in _ranges(condition, of))
             + f"        if (!({' || '.join(_holds(chain, of) for chain in condition.split('|'))})) return {k + 1};\n"
             "    }\n"
             for k, condition in enumerate(of.conditions)]
    return (f"EXPORT i64 {name}_broken(const Slot *s, u64 asked) {{\n    (void)s, (void)asked;\n{''.join(tests)}"
            "    return 0;\n}")


def _arrays(condition: str, of: Declared) -> Iterator[tuple[Argument, str]]:
    """Yield the arrays that a condition is about, and the C expressions of their places."""
    for name in names(condition):
        for k, argument in enumerate(of.arguments):
            if argument.name == name and argument.lengths:
                yield argument, f"s[{len(of.lengths) + k}].place"


def _given(condition: str, of: Declared) -> list[str]:
    """Return C expressions that are true where arrays are not None."""
    return [place for argument, place in _arrays(condition, of) if "?" in argument.marks]


def _ranges(condition: str, of: Declared) -> Iterator[str]:
    """Yield C statements that find the least and the largest value of arrays."""
    for argument, place in _arrays(condition, of):
        if argument.name in re.split(r"<=|<|=|\|", condition):
            kind = {"bool": "u8"}.get(argument.kind, argument.kind)
            count = " * ".join(_term(length, of) for length in argument.lengths)
            found = "Reals" if kind[0] == "f" else "Wholes"
            yield f"const {found} {argument.name}_range = range_{kind}({place}, {count});"


def _holds(chain: str, of: Declared) -> str:
    """Return the C expression of one alternative of a condition: a<=b<c, or a function that is true."""
    parts = re.split(r"(<=|<|=)", chain)
    if len(parts) == 1:
        return f"({_expression(chain, of)})"
    pairs = zip(parts[:-2:2], parts[1:-1:2], parts[2::2], strict=True)
    return "(" + " && ".join(f"{_side(a, of, 'most')} {'==' if op == '=' else op} {_side(b, of, 'least')}"
                             for a, op, b in pairs) + ")"


def _side(text: str, of: Declared, end: str) -> str:
    """Return one side of a comparison: of an array its largest value if it is on the left, else its least."""
    array = any(argument.name == text and argument.lengths for argument in of.arguments)
    return f"{text}_range.{end}" if array else _expression(text, of)


def _expression(text: str, of: Declared) -> str:
    """Return C of lengths, numbers, + − * / and functions. Products are taken of numbers that have room for them."""
    wide = "(wide)" if "*" in text else ""
    return re.sub(r"[A-Za-z_]\w*", lambda word: (wide if word[0] not in _FUNCTIONS else "") + _term(word[0], of), text)


def _term(word: str, of: Declared) -> str:
    """Return C of one word: a length, a number, an argument or a function."""
    if word in _FUNCTIONS:
        return {"inf": "INFINITY"}.get(word, word)
    if word.isdigit():
        return word
    found = [argument.name for argument in of.arguments].index(word) if word not in of.lengths else -1
    if found < 0:
        return f"s[{of.lengths.index(word)}].integer"
    argument, slot = of.arguments[found], len(of.lengths) + found
    if not argument.lengths:
        return f"s[{slot}].{_MEMBERS[argument.kind]}"
    *rows, last = (_term(length, of) for length in argument.lengths)
    return f"s[{slot}].place, {' * '.join(rows) or '1'}, {last}"
