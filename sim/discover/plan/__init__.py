"""Planning: identifiability, expected information and experiment design."""
