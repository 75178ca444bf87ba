"""A scene's forward map as C for machines without Python, CasADi or a heap."""
