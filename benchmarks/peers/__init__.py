"""One driver per peer: each a module that knows arrays only, for an interpreter that has that peer."""
