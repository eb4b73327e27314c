"""A module for each command: what it takes from the command line, and what it runs.

These modules import next to nothing. What takes long to import is imported when a command runs, by
`streams.load`, so that help and completion come at once.
"""
