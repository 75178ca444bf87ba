"""Settled arms for other programs: meshes, chains of rigid links, messages."""
