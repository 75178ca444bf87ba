"""Studies. Each study answers one question; see studies/README.md."""
