"""Input and output: keys, units, files and records; no other folder defines formats."""
