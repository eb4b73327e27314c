"""The guaranteed bound for solutions of other methods, right and wrong ones, over their true errors."""
