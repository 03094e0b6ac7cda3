"""Commands from datasets to findings."""
