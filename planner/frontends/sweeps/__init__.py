"""Sweeps: one question asked at many values of a scene, in parallel, and gathered in a Dataset."""
