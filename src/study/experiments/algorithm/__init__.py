"""Uzawa's algorithm and the Lagrangian, tried on one mesh."""
