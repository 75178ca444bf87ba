"""The commands of `octoplan`: functions whose parameters are command line parameters."""
