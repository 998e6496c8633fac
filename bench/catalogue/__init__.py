"""Which runs there are, what differs between two of them, and what earlier ones tell of the time a new one takes."""
