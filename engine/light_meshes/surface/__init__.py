"""What a surface returns of the light that arrives: Ω, and textures."""
