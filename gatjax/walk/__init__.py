"""The Walk2014 walk engine: from a walk request to joint targets, for numpy and jax."""
