"""Recordings to named causes, to an extended World and its measured gain."""
