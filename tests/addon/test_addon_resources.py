"""Too little disk space or memory, and unreadable textures, give a clear sentence, and the next render works."""

import re

from faults import go


def test_a_full_disk(tmp_path, small_disk):
    """Full when the scene is written, when there is room for that but not for the picture, and not any more."""
    prefix, disk = small_disk
    lines, _ = go(tmp_path, """
        disk = Path(os.environ["TMPDIR"])

        def fill(free):
            (disk / "filler").unlink(missing_ok=True)
            there = os.statvfs(disk)
            (disk / "filler").write_bytes(b"0" * (there.f_bavail * there.f_frsize - free))

        own.shadows, own.samples = 'SHARP', 1
        fast()
        scene.render.resolution_x, scene.render.resolution_y = 320, 240  # 1.2 MB
        render()
        for free in (0, 300_000, 3_000_000):
            fill(free)
            render()
            print("LEFT", [p for job in disk.glob("light-meshes-*") for p in job.iterdir()])
        leave()
    """, prefix=prefix, TMPDIR=disk)
    assert lines[0] == lines[5] == "RESULT {'FINISHED'} True"
    assert re.fullmatch(r"ERROR Error: The scene cannot be handed to the Light Meshes engine: "
                        r"(No space left on device|the disk is full).* False", lines[1])
    assert re.fullmatch(r"ERROR Error: Light Meshes: the disk is full: the engine writes to .* False", lines[3])
    assert lines[2] == lines[4] == lines[6] == "LEFT []"


def test_too_little_memory(tmp_path):
    """A limit on the engine's address space, by so much above what it has: it says so, and the next one works."""
    lines, output = go(tmp_path, """
        import re, resource
        fast()
        cube = bpy.data.objects["Cube"]
        render()
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=900, y_subdivisions=900)
        grid = bpy.context.object
        for extra in (8, 30, 60):
            size = re.search(r"VmSize:\\s+(\\d+) kB", Path(f"/proc/{child()}/status").read_text())
            limit = (int(size[1]) << 10) + (extra << 20)
            resource.prlimit(child(), resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
            grid.hide_render = False
            render()
            if "render" in session._sessions:
                resource.prlimit(child(), resource.RLIMIT_AS, (resource.RLIM_INFINITY,) * 2)
            grid.hide_render = True
            render()
        leave()
    """)
    assert lines[::2] == ["RESULT {'FINISHED'} True"] * 4
    for line in lines[1::2]:
        assert re.fullmatch(r"ERROR Error: [^|]*(out of|for want of) memory[^|]* False", line), output


def test_textures_that_cannot_be_read(tmp_path):
    """Each is named in a warning, it is magenta, and the picture is made."""
    (tmp_path / "textures").mkdir()
    png = tmp_path / "textures" / "made.png"
    lines, _ = go(tmp_path, f"""
        fast()
        image = bpy.data.images.new("made", 64, 64)
        image.filepath_raw, image.file_format = {str(png)!r}, 'PNG'
        image.pixels.foreach_set(__import__("random").Random(1).choices((0.0, 0.5, 1.0), k=64 * 64 * 4))
        image.save()
        folder = Path({str(tmp_path / "textures")!r})
        whole = Path({str(png)!r}).read_bytes()
        for name, content in {{"cut.png": whole[:len(whole) // 2], "empty.png": b"", "noise.png": b"no picture",
                              "huge.png": whole[:16] + b"\\x00\\x0f\\xff\\xff" * 2 + whole[24:]}}.items():
            (folder / name).write_bytes(content)
        (folder / "folder.png").mkdir()
        names = ["cut.png", "empty.png", "noise.png", "huge.png", "folder.png", "missing.png", "long" * 70 + ".png"]
        cube = bpy.data.objects["Cube"]
        for n, name in enumerate(names):
            material = bpy.data.materials.new(name[:8])
            if bpy.app.version < (5, 0):
                material.use_nodes = True
            node = material.node_tree.nodes.new('ShaderNodeTexImage')
            node.image = bpy.data.images.new(name[:8], 4, 4)
            node.image.source, node.image.filepath = 'FILE', str(folder / name)
            material.node_tree.links.new(node.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs[0])
            copy = bpy.data.objects.new(name[:8], cube.data.copy())
            copy.data.materials.clear()
            copy.data.materials.append(material)
            copy.location.x = n
            scene.collection.objects.link(copy)
        observers.observers.append(lambda e: e["event"] == "warning" and print("WARNING", e["message"], flush=True))
        render()
        leave()
    """)
    assert lines[-1] == "RESULT {'FINISHED'} True"
    for name in ("cut.png", "empty.png", "noise.png", "huge.png", "folder.p", "missing.", "longlong"):
        said = "is a folder" if name == "folder.p" else "cannot be read"
        assert any(name in line and said in line for line in lines), (name, lines)
