"""Selection and ranking of candidate terms."""
