"""Tests of the structure of any simulator against its recordings."""
