"""Light Meshes: soft shadows from point lights by the light meshes method (Debelov et al., 2008)."""

__version__ = "0.1.0"
