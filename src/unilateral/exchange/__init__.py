"""What goes to other solvers and what comes back: cases written as files, foreign solutions scored."""
