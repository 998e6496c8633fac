"""First power-on of a station: what its instruments say and do, measured, with a report."""
