"""Formulas: parsed by a whitelist, evaluated on arrays, and enclosed with guaranteed remainders."""
