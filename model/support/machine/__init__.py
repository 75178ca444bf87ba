"""Faster evaluation of CasADi functions: in batches, as machine code, without call overhead."""
