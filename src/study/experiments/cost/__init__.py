"""What accuracy costs: runs of every algorithm, stop, precision and size, with their operations counted."""
