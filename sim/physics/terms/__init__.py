"""Physics terms: a page of effects for each stage."""
