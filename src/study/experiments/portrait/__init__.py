"""One solution, shown."""
