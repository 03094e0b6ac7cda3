"""Physics terms, one module of effects per stage."""
