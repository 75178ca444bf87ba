"""Planning beyond one arm in free space; no module of the core imports them."""
