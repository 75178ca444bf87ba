"""Effects and methods beyond the core; no module of the core imports them."""
