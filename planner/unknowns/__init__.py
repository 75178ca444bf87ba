"""Numbers of arm, effects and measurement as unknowns, by their keys in scene files."""
