"""Checks a built wheel by what it holds: the tag in its name, its metadata, and the head of each compiled library.

A wheel that was compiled for another platform cannot be tried here, but its libraries say what they need: the
processor, the other libraries, and the oldest system. This module reads that from ELF (Linux), PE (Windows) and Mach-O
(macOS) files, and compares it with what the wheel's tag promises.
"""

import re
import struct
import zipfile
from pathlib import Path
from typing import NamedTuple

GONE = ("numba", "llvmlite")  # the first release needed them
# What each system has for every program. On Windows the C library is a part of the system since Windows 10.
SYSTEM = {
    "linux": re.compile(r"lib(c|m|pthread|dl|rt)\.so\.\d+|ld-linux-[\w-]+\.so\.\d"),
    "win32": re.compile(r"(kernel32|ntdll|ucrtbase|api-ms-win-crt-[\w-]+)\.dll", re.IGNORECASE),
    "darwin": re.compile(r"/usr/lib/libSystem\.B\.dylib"),
}


class LibraryError(Exception):
    """A wheel is not what its name says. The message says why."""


class Library(NamedTuple):
    """The facts that a compiled library states about itself."""

    system: str  # as sys.platform
    machine: str  # x86_64 or arm64
    needs: frozenset[str]  # the other libraries that it loads
    oldest: tuple[int, ...]  # the C library (Linux) or system (macOS) that it needs; () where it does not say
    signed: bool  # macOS loads no unsigned library on arm64


def check_wheel(path: Path, version: str, tag: str, names: set[str]) -> list[str]:
    """Check the libraries of the wheel at `path`, and describe each in one line. `tag` is the platform in the wheel's
    name, and `names` are the libraries that it must hold, such as `kernels.so`. Raises LibraryError.
    """
    if path.name != f"light_meshes-{version}-py3-none-{tag}.whl" or not re.fullmatch(r"\d+(\.\d+)*", version):
        raise LibraryError(f"{path.name} is not the name of version {version} for all Pythons on {tag}")
    with zipfile.ZipFile(path) as wheel:
        info = f"light_meshes-{version}.dist-info"
        metadata, said = (wheel.read(f"{info}/{name}").decode() for name in ("METADATA", "WHEEL"))
        if f"Tag: py3-none-{tag}\n" not in said or f"\nVersion: {version}\n" not in metadata:
            raise LibraryError(f"{path.name}: its metadata is of another version or platform")
        if found := [name for name in GONE if any(name in text for text in (metadata, *wheel.namelist()))]:
            raise LibraryError(f"{path.name} has or needs {' and '.join(found)}")
        libraries = {name: read(wheel.read(name)) for name in wheel.namelist()
                     if name.endswith((".so", ".dll", ".dylib", ".pyd"))}
    if set(libraries) != {f"light_meshes/{name}" for name in names}:
        raise LibraryError(f"{path.name} holds {sorted(libraries)}, and should hold {sorted(names)}")
    for name, library in libraries.items():
        if wrong := complaint(library, tag):
            raise LibraryError(f"{path.name}: {name} {wrong}")
    return [f"{name}: {library.system} {library.machine}, needs {', '.join(sorted(library.needs))}"
            f"{' of ' if library.oldest else ''}{'.'.join(map(str, library.oldest))}"
            for name, library in libraries.items()]


def complaint(library: Library, tag: str) -> str:
    """Return why a library cannot be in a wheel with this platform tag, or an empty string."""
    system, machine, oldest = promised(tag)
    if (library.system, library.machine) != (system, machine):
        return f"is for {library.system} {library.machine}"
    if foreign := sorted(name for name in library.needs if not SYSTEM[system].fullmatch(name)):
        return f"needs {', '.join(foreign)}, which not every system has"
    if library.oldest > oldest:
        return f"needs {'.'.join(map(str, library.oldest))}, newer than the tag says"
    if (system, machine) == ("darwin", "arm64") and not library.signed:
        return "is not signed, so that macOS would not load it"
    return ""


def promised(tag: str) -> tuple[str, str, tuple[int, ...]]:
    """Return the system, the processor, and the oldest C library or system that a wheel's platform tag promises to
    need.
    """
    if tag == "win_amd64":
        return "win32", "x86_64", ()
    if found := re.fullmatch(r"macosx_(\d+)_(\d+)_(x86_64|arm64)", tag):
        return "darwin", found[3], (int(found[1]), int(found[2]))
    if found := re.fullmatch(r"manylinux(2014|_(\d+)_(\d+))_(x86_64|aarch64)", tag):
        oldest = (2, 17) if found[1] == "2014" else (int(found[2]), int(found[3]))
        return "linux", found[4].replace("aarch64", "arm64"), oldest
    raise LibraryError(f"{tag} is no platform that is known here")


def read(data: bytes) -> Library:
    """Return a description of a library from the contents of its file. Only 64-bit little-endian files are read,
    because all targets are such.
    """
    try:
        if data[:6] == b"\x7fELF\x02\x01":
            return _read_elf(data)
        if data[:2] == b"MZ":
            return _read_pe(data)
        if data[:4] == b"\xcf\xfa\xed\xfe":
            return _read_macho(data)
    except (struct.error, IndexError, KeyError, ValueError) as e:
        raise LibraryError(f"a library cannot be read: {e!r}") from e
    raise LibraryError(f"{data[:4]!r} is the beginning of no library")


def _text(data: bytes, at: int) -> str:
    """Return the string that ends with a zero, at an offset."""
    return data[at:data.index(b"\0", at)].decode()


def _read_elf(data: bytes) -> Library:
    machine = {62: "x86_64", 183: "arm64"}[struct.unpack_from("<H", data, 18)[0]]
    table, = struct.unpack_from("<Q", data, 40)
    size, count = struct.unpack_from("<HH", data, 58)
    # A section: name, type, flags, address, offset, size, link, info, alignment, size of an entry.
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, table + k * size) for k in range(count)]
    needs: set[str] = set()
    versions: set[tuple[int, ...]] = {(0,)}
    for section in sections:
        kind, offset, length, names = section[1], section[4], section[5], sections[section[6]][4]
        if kind == 6:  # SHT_DYNAMIC: pairs of a tag and a value
            for tag, value in struct.iter_unpack("<QQ", data[offset:offset + length]):
                if tag == 1:  # DT_NEEDED
                    needs.add(_text(data, names + value))
        elif kind == 0x6FFFFFFE:  # SHT_GNU_verneed: chains of versions, one for each library
            at, following = offset, 1
            while following:
                _, _, _, first, following = struct.unpack_from("<HHIII", data, at)
                one, after = at + first, 1
                while after:
                    *_, name, after = struct.unpack_from("<IHHII", data, one)
                    if found := re.fullmatch(r"GLIBC_([\d.]+)", _text(data, names + name)):
                        versions.add(tuple(map(int, found[1].split("."))))
                    one += after
                at += following
    return Library("linux", machine, frozenset(needs), max(versions), False)


def _read_pe(data: bytes) -> Library:
    head, = struct.unpack_from("<I", data, 0x3C)
    if data[head:head + 4] != b"PE\0\0":
        raise LibraryError("a library for Windows has no PE header")
    machine_number, count = struct.unpack_from("<HH", data, head + 4)
    optional, = struct.unpack_from("<H", data, head + 20)
    imports, = struct.unpack_from("<I", data, head + 24 + 112 + 8)
    # A section: size in memory, address in memory, size in the file, offset in the file.
    sections = [struct.unpack_from("<IIII", data, head + 24 + optional + 40 * k + 8) for k in range(count)]

    def place(address: int) -> int:
        for size, start, _, offset in sections:
            if start <= address < start + size:
                return offset + address - start
        raise LibraryError("an address of a library for Windows is in none of its sections")

    needs = set()
    at = place(imports)
    while name := struct.unpack_from("<I", data, at + 12)[0]:
        needs.add(_text(data, place(name)))
        at += 20
    return Library("win32", {0x8664: "x86_64", 0xAA64: "arm64"}[machine_number], frozenset(needs), (), False)


def _read_macho(data: bytes) -> Library:
    machine = {0x01000007: "x86_64", 0x0100000C: "arm64"}[struct.unpack_from("<I", data, 4)[0]]
    count, = struct.unpack_from("<I", data, 16)
    needs: set[str] = set()
    oldest: tuple[int, ...] = ()
    signed, at = False, 32
    for _ in range(count):
        command, size = struct.unpack_from("<II", data, at)
        if command == 0xC:  # LC_LOAD_DYLIB
            needs.add(_text(data, at + struct.unpack_from("<I", data, at + 8)[0]))
        elif command == 0x32:  # LC_BUILD_VERSION
            version, = struct.unpack_from("<I", data, at + 12)
            oldest = (version >> 16, version >> 8 & 255)
        elif command == 0x1D:  # LC_CODE_SIGNATURE
            signed = True
        at += size
    return Library("darwin", machine, frozenset(needs), oldest, signed)
