"""Light Meshes: soft shadows from point lights by the light meshes method (Debelov et al., 2008)."""

import sys

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]  # remove the current folder from the path when run as a program: nothing in it may be run

__version__ = "0.1.0"
