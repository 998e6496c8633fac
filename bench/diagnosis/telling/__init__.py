"""A comparison and a diagnosis as a person reads them, and as files."""
