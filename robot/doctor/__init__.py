"""Is this robot fit to run? Each check is given what it needs, changes nothing, and says one line."""
