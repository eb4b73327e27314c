"""beta over families of meshes and partitions."""
