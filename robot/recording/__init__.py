"""Recordings of sessions: writing, reading and recovery."""
