"""Light that bends on its way through glass: media and interfaces, and the solver of refracted paths."""
