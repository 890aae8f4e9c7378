"""Make every .blend of this folder: `python blend_scenes/make.py`.

It needs bpy and the add-on of this project. Use bpy 4.2, so that every supported Blender can open the files.
"""

import sys

import desk
import glass
import hall
import lights
import limits
import tabletop

if __name__ == "__main__":
    chosen = sys.argv[1:]
    for scene in (tabletop, glass, lights, hall, desk, limits):
        if not chosen or scene.__name__ in chosen:
            scene.make()
