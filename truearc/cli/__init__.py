"""One file a verb of the command line. Only doors build things; everything else is handed what it needs."""
