"""What is solved: cases with a known solution, and problems of one's own; both give f, g and a polygon."""
