"""From events to response tables, S-curves, thresholds and background rates."""
