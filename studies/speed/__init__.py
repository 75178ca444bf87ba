"""How fast it is, and what of it takes how long: `python -m studies.speed --help`."""
