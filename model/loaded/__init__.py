"""Arms under loads: a boundary value problem by multiple shooting from tip to base."""
