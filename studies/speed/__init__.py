"""Studies of speed and accuracy: `python -m studies.speed --help` lists the questions."""
