"""Side by side with other solvers: what `make bench` and `make score` have measured."""
