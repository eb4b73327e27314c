"""The project side by side with other solvers: what runs, on which problems, how it is measured and told."""
