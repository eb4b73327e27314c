"""The experiments, a room each: what is measured, checked, drawn and told."""
