"""Where the method, the algorithm and this code break."""
