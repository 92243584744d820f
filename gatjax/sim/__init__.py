"""The simulator: worlds, one control tick, and the backends that run many of them."""
