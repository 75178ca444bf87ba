"""Equilibria of an arm that leans on rigid obstacles."""
