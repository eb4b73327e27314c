"""The multiplier of 1980 beside those of other methods, on the same meshes."""
