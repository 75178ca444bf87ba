"""Figures; nothing else in the project knows matplotlib."""
