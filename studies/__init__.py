"""Studies: one question each, with its answer."""
