"""Sweeps: settle, plan or stiffness at many values of a scene, in parallel, as one Dataset."""
