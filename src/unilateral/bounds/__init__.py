"""Guaranteed bounds on the errors of a discrete solution whose exact solution is not known."""
