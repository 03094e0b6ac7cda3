"""Terms of the sensing stage: what sensors and trackers read."""
