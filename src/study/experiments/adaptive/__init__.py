"""Uniform meshes beside adapted ones."""
