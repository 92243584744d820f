"""Score the diagnosis, and simpler methods, on cases whose answers are known."""
