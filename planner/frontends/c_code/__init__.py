"""Export of a scene's forward map as C code without Python, CasADi or a heap."""
