"""Light meshes: the lattice, its nodes and their values, and the means over nodes."""
