"""What studies.speed.accuracy measures: error over time, by way and setting."""
