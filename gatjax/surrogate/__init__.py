"""Robots to transfer to: bodies with hidden effects in other physics engines."""
