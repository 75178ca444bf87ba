"""Arms without loads: strains in closed form or integrated, poses, and their derivatives."""
