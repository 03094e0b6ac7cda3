"""The linearised statistical model behind discovery."""
