"""Arcs that certainly touch or do not, beside exact contact sets, and the lengths left between them."""
