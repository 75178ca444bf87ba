"""Equilibria under given tendon lengths."""
