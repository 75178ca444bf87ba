"""Equilibria as least potential energy under rows that hold lengths of tendons and gaps."""
