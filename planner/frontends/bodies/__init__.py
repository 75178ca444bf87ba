"""Settled arms as bodies for other programs: meshes, chains of rigid links, messages."""
