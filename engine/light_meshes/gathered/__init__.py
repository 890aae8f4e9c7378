"""Light from everywhere, gathered at surfaces: the world's light with occlusion, emitting meshes, diffuse bounces."""
