"""Large meshes by multigrid, beside what was predicted of them."""
