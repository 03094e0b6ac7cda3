"""The proof of discovery on concealed worlds, which are made by code that the solver does not share."""
