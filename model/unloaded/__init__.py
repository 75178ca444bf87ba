"""Arms without loads, in closed form or as the paper prints them, and derivatives of the tip."""
