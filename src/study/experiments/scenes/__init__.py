"""All cases of the scenes on all levels: errors, their rates, floors, and guaranteed totals."""
