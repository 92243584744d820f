"""Recordings of a robot: reading, checking and splitting them."""
