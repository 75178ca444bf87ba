"""Shapes under given tendon lengths."""
