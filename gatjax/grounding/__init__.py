"""Ways to learn a correction of the actions from recordings."""
