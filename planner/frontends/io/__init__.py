"""How everything is written and read: the one place that knows keys, units, files and records."""
