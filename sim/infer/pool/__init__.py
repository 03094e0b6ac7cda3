"""Several fits as one: what rigs or sessions have in common, and by how much they differ."""
