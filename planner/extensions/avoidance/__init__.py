"""Keeping clear: what is asked of an arm's surroundings, and the inequalities that hold it."""
