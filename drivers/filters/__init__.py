"""Filter wheels, and people who change filters."""
