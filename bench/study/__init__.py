"""Studies: simulated pixels whose truth is known, measured as protocols say, and held against what was claimed."""
