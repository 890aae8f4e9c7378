"""What a scene is, and the same as a folder, which is not trusted."""
