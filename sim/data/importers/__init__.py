"""Other people's recordings -> datasets (formats.md section 1), one importer a file."""
