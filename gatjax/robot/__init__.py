"""What a NAO is: its model, its joints, their limits and their motors."""
