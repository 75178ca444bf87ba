"""Force sensing: the load on an arm, estimated from measured positions."""
