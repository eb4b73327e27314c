"""How sharp the estimates are within a family of transitions."""
