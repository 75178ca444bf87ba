"""Motions: tensions over time, through targets, within limits on their rates."""
