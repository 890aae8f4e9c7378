"""Calls of the compiled kernels: a wrong call is a Python error, and the declaration of a kernel agrees with its C
code.
"""

import gc
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import weakref
from pathlib import Path
from types import BuiltinFunctionType

import numpy as np
import pytest
from light_meshes.scene import snapshot
from light_meshes.support import native, sources
from scenes import tabletop

SUPPORT = Path(__file__).parents[1] / "support"

PACKAGE = Path(native.__file__).parents[1]
TEXTS = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.[ch]")}
NAMES = sorted(set(re.findall(r"^KERNEL\((\w+),", "\n".join(TEXTS.values()), re.M)))
MACROS = dict(re.findall(r"#define (TAKEN|OF_\w+)((?:.*\\\n)*.*)", "\n".join(TEXTS.values())))
# Kernels whose text stands once for several types.
OF_TYPES = ["semitransparent_mean", "semitransparent_mean_apart",
            *(f"textures_look_{kind}" for kind in ("u8", "u16", "f32"))]


@pytest.mark.parametrize("name", NAMES + OF_TYPES)
def test_every_kernel_can_be_called(name):
    kernel = native.kernel(name)
    with pytest.raises(TypeError, match=f"{name} takes"):
        kernel(*[None] * (len(kernel.takes.split()) + 1))


@pytest.mark.parametrize("name", NAMES)
def test_a_kernel_takes_what_its_text_says(name):
    """The C parameters behind the text: lengths first, in the order of their letters, then the arguments."""
    text = next(t for t in TEXTS.values() if re.search(rf"\bi64 {name}\(", t))
    for macro, body in MACROS.items():
        text = re.sub(rf"\b{macro}(?=[,)])", lambda _, body=body: body.replace("\\\n", " "), text)
    parameters = re.search(rf"\bi64 {name}\(([^)]*)\)", text)[1]
    declared = [re.sub(r"\s+", " ", p).strip() for p in parameters.split(",")] if parameters != "void" else []
    kernel = native.kernel(name)
    lengths, arguments = len(kernel._lengths), kernel._arguments
    assert all(p.startswith("i64 ") and "*" not in p for p in declared[:lengths])
    assert len(declared) == lengths + len(arguments)
    for parameter, (_, kind, shape, *_) in zip(declared[lengths:], arguments, strict=True):
        found = re.fullmatch(r"(?:const )?(\w+) (\*?)\w+", parameter)
        assert found[1] == {"bool": "u8"}.get(kind, kind), parameter
        assert bool(found[2]) == (shape is not None), parameter


@pytest.mark.parametrize("path", [path for path in TEXTS if path.suffix == ".h"], ids=lambda path: path.name)
def test_a_header_declares_kernels_as_exported(path):
    """Otherwise Windows' compiler refuses the kernel."""
    declared = re.findall(r"^(.*)\bi64 (\w+)\((?=[^{};]*\);)", TEXTS[path], re.M)
    assert [name for before, name in declared if name in NAMES and "EXPORT" not in before] == []


P = np.zeros((4, 3))


@pytest.mark.parametrize(("arguments", "error", "says"), [
    ((P, P, P), TypeError, "takes 4 arguments"),
    ((P.astype(np.float32), P, P, P.copy()), TypeError, "way must be f64"),
    ((P.ravel(), P, P, P.copy()), TypeError, "2 axes"),
    ((P, P[:3], P, P.copy()), ValueError, "does not fit"),
    ((P, P, P, np.zeros((4, 2))), ValueError, "does not fit"),
    ((P, P, np.zeros((4, 6))[:, ::2], P.copy()), ValueError, "contiguous"),
    ((P, P, P, np.broadcast_to(0.0, (4, 3))), ValueError, "contiguous"),
    ((P, P, P, np.frombuffer(bytes(96)).reshape(4, 3)), ValueError, "writable"),
    ((P, P, P, None), TypeError, "NoneType"),
    ((P, P, P, "out"), TypeError, "str"),
])
@pytest.mark.parametrize("how", ["__call__", "checked"])
def test_a_wrong_call_is_an_error(arguments, error, says, how):
    """By the checks in C, and by those in Python."""
    kernel = native.kernel("shading_mirrored")
    kernel(P, P, P, P.copy())
    assert isinstance(kernel.fast, BuiltinFunctionType)
    with pytest.raises(error, match=says):
        getattr(kernel, how)(*arguments)


def test_numbers_of_any_type_are_the_same():
    """Whole numbers, real numbers and truth values, of Python and of numpy; what none can be is an error."""
    kernel, S = native.kernel("pairs_set"), np.zeros((2, 3), np.float32)
    for three, one in itertools.product([3, np.int32(3), np.uint8(3), 3.0], [1, 1.0, np.float32(1), True, np.True_]):
        S[:] = 0
        kernel(np.full((2, 1), 5, np.uint64), three, one, S)
        assert (S == [1, 0, 1]).all()
    for wrong in ("three", None, P):
        with pytest.raises((TypeError, ValueError)):
            kernel(np.full((2, 1), 5, np.uint64), wrong, 1.0, S)


def test_given_arguments_live_as_long_as_the_function_and_no_longer():
    N = P.copy()
    alive = weakref.ref(N)
    function = native.kernel("shading_mirrored").of(P, N)
    del N
    gc.collect()
    assert alive() is not None
    function(P + 1, P.copy())
    del function
    gc.collect()
    assert alive() is None


def a_chain(count):
    """Calls of which each mirrors what the one before has written, and these arrays (count+1,4,3)."""
    kernel, rng = native.kernel("shading_mirrored"), np.random.default_rng(count)
    arrays, N = rng.normal(size=(count + 1, 4, 3)), rng.normal(size=(4, 3))
    kernel(N, N, N, N.copy())
    first = [(kernel, N), (kernel.of(N),)]
    return [(*first[k % 2], N, arrays[k], arrays[k + 1]) for k in range(count)], arrays


@pytest.mark.parametrize("count", [1, 2, 8, 9])
def test_kernels_called_together_do_the_same_as_one_by_one(count):
    """Each needs what the one before has written. More than 8 are called from Python."""
    calls, arrays = a_chain(count)
    assert native.together(*calls) == [0] * count
    others, same = a_chain(count)
    for function, *arguments in others:
        function(*arguments)
    np.testing.assert_array_equal(arrays, same)


def test_python_functions_can_be_among_the_calls():
    calls, arrays = a_chain(2)
    others, same = a_chain(2)
    native.together(*others)
    assert native.together(calls[0], (lambda a: a.size, P), calls[1]) == [0, 12, 0]
    np.testing.assert_array_equal(arrays, same)


@pytest.mark.parametrize(("change", "error"), [
    (lambda call: (*call[:-1], np.zeros((4, 2))), ValueError),
    (lambda call: (*call[:-1], np.zeros((4, 3), np.float32)), TypeError),
    (lambda call: (*call[:-1], "out"), TypeError),
    (lambda call: (*call, P), TypeError),
    (lambda call: call[:-1], TypeError),
])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_wrong_call_among_those_together_is_an_error(change, error, which):
    calls, _ = a_chain(3)
    calls[which] = change(calls[which])
    with pytest.raises(error):
        native.together(*calls)


def test_declarations_in_pieces_are_joined():
    """As macros leave them: a type in a text of its own, and lengths after it."""
    expanded = ('const char some_takes[] = "P f64[n,3]  texels "\n "u8" "[h,n]  h f64  k u64  "; '
                'const char no_takes[] = "";')
    text = sources.calls(expanded)
    assert "i64 some(i64, i64, const void *, const void *, f64, u64);" in text and "i64 no(void);" in text
    assert "return some(s[0].integer, s[1].integer, s[2].place, s[3].place, s[4].real, s[5].whole);" in text


def test_an_unknown_kernel_is_an_error():
    with pytest.raises(AttributeError):
        native.kernel("no_such_kernel")


PICTURE = """
import hashlib, numpy as np
from light_meshes.picture.render import render_image
from scenes import four_lights
picture = render_image(four_lights(60, shadows="LIGHT_MESHES", weights="SMOOTH"), ("Combined",))
print(hashlib.sha256(picture.passes["Combined"].tobytes()).hexdigest())
"""


def test_all_processors_give_the_same_bits():
    levels = [level for level in ("kernels", "kernels-avx2")
              if (PACKAGE / sources.library(sys.platform, level)).exists()]
    found = set()
    for level in levels if native.kernel("processor_has_avx2")() else levels[:1]:
        environment = os.environ | {"LIGHT_MESHES_KERNELS": level, "PYTHONPATH": str(SUPPORT)}
        found.add(subprocess.run([sys.executable, "-c", PICTURE], env=environment, capture_output=True, text=True,
                                 check=True).stdout)
    assert len(found) == 1


@pytest.fixture(params=["cannot be loaded", "older than their C sources"])
def broken(request, tmp_path):
    """A folder with an engine that has no library, or one of other sources, and what it says."""
    missing = request.param == "cannot be loaded"
    shutil.copytree(PACKAGE, tmp_path / "light_meshes",
                    ignore=shutil.ignore_patterns("__pycache__", *["kernels*"] * missing))
    (tmp_path / "light_meshes" / "more.c").touch()
    return tmp_path, f"the engine's kernels {'' if missing else 'are '}{request.param}"


@pytest.mark.parametrize("module", ["cli", "frontends.service"])
def test_what_cannot_be_called_is_told_in_a_sentence(broken, module):
    folder, sentence = broken
    snapshot.write(tabletop(8), folder / "scene")
    command = {"command": "render", "id": 1, "snapshot": str(folder / "scene"), "framebuffer": "frame"}
    arguments = ["render", folder / "scene", "-o", folder / "out.png"] if module == "cli" else []
    with subprocess.Popen([sys.executable, "-m", f"light_meshes.{module}", *map(str, arguments)], text=True,
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          env=os.environ | {"PYTHONPATH": str(folder)}) as child:
        if module == "cli":
            _, log = child.communicate()
            assert child.returncode == 1 and log.startswith(f"light-meshes: {sentence}") and log.count("\n") == 1
            return
        child.stdin.write(json.dumps(command) + "\n")
        child.stdin.flush()
        events = iter(lambda: json.loads(child.stdout.readline()), None)
        error = next(event for event in events if event["event"] == "error")
        assert error["id"] == 1 and error["message"].startswith(sentence)
        _, log = child.communicate(json.dumps({"command": "quit"}) + "\n")
        assert child.returncode == 0 and log == ""


def test_other_threads_run_while_a_kernel_does():
    assert isinstance(native._LIBRARY, native.ctypes.CDLL) and not isinstance(native._LIBRARY, native.ctypes.PyDLL)
