"""Meshes graded to a vertex at which u is singular: what grading does for the multiplier."""
