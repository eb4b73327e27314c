"""Linear finite elements: quadrature, matrices, loads, and the elimination of the interior unknowns."""
