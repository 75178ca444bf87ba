"""Motions: tensions over time that pass through targets within rate limits."""
