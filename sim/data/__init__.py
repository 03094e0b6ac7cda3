"""A dataset of shots on disk: reading it strictly, writing it exactly."""
