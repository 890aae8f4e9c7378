"""Light that glass bends: media and interfaces, and the solver for refracted paths."""
