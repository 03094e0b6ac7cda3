"""truearc: a ball launcher that knows whether its shot will score, and says which physics its simulation left out."""
