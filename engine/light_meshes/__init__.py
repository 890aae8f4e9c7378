"""Light Meshes: soft shadows from point lights by the light meshes method (Debelov et al., 2008)."""

import sys

if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]  # run as a program: nothing of the current folder is run

__version__ = "0.1.0"
