"""The schemes that carry strains and poses along the arm, a file for each kind."""
