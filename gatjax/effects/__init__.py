"""What a real robot does to a command or a reading and a plain model does not."""
