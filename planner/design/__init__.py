"""Design: numbers of an arm that make its tasks cheapest."""
