"""Polygons, the partitions T_H of their boundary, and the triangulations behind V_h."""
