"""The instruments: interfaces, real drivers, and decoders of event streams."""
