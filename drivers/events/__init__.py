"""Event streams: their types, and decoders of the formats in which sensors send them."""
