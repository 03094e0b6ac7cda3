"""The gate: contract, model and verdict."""
