"""Standing robots: loads from full simulations, and causes that only they show."""
