"""Guaranteed bounds of the errors of a discrete solution whose exact solution is not known."""
