"""Physics terms, one file each, by stage."""
