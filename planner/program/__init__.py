"""The nonlinear program: what is unknown, wanted and allowed, with exact derivatives."""
