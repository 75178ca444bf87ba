"""The commands of `octoplan`: functions whose parameters are those of the command line."""
