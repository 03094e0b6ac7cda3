"""Scores of findings against concealed truth."""
