"""From initial guesses to an optimum: ipopt, Newton's last digits, and following an optimum."""
