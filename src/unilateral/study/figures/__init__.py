"""The figures, a module each: the table that it is drawn from, and its drawing, which computes nothing.

`table` makes the table from the study's results, and `draw` an SVG from the table's rounded CSV file alone.
"""
