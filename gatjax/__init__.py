"""Robot logs in; a simulator that agrees with them, and a walk that transfers, out."""

__version__ = "0.1.0"
