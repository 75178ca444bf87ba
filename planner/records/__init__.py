"""Results as records: what is written to files and told to machines, with a schema each.

SI units, angles in rad; keys name the unit of numbers that have one. Keys are added, never renamed
or removed, while the number at the end of `schema` stays.
"""
