"""Workspaces: the tips that an arm reaches within tension limits, and their boundary."""
