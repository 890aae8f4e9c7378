"""How a surface reflects arriving light: Ω, and textures."""
