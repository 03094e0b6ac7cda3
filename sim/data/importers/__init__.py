"""Importers: other people's recordings -> datasets (folders with rig.toml and shots.csv), one per file."""
