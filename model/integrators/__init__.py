"""Steps along the arm: Magnus expansions for poses, explicit Runge-Kutta schemes for rates."""
