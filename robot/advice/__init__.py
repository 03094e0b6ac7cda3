"""Advice beside a robot that drives itself: its NetworkTables keys in, the tick's verdict out; nothing is commanded."""
