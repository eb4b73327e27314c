"""The steps of Theorem 4.1, and the dual norm in which they are measured."""
