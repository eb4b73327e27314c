"""What the size of the cells alone does, where there are infinitely many transitions."""
