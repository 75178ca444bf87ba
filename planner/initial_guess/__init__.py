"""Initial guesses of a search: tensions of curled arms and fits to the targets."""
