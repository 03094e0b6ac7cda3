"""Commands that the proof distribution adds to truearc."""
