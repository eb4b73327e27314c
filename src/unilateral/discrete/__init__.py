"""The discrete problem (P_h*), condensed to the boundary or on nested levels, and the choice between them."""
