"""How a settled shape answers to forces, moments and tensions, and whether it is stable."""
