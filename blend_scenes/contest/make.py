"""Make the eight scenes of the contest: `python blend_scenes/contest/make.py FOLDER [name …]`.

They are not kept in the repository. `light-meshes contest` makes those that its folder has not.
"""

import importlib
import sys
from pathlib import Path

SCENES = ("still_life", "room", "night_hall", "stage", "product", "street", "forest", "exhibition")


def make(folder, names=SCENES):
    sys.path.insert(0, str(Path(__file__).parent))
    for name in names:
        importlib.import_module(name).make(folder)


if __name__ == "__main__":
    make(sys.argv[1], sys.argv[2:] or SCENES)
