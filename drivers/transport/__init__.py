"""The bytes between computer and instruments: ports, links that ask and answer, and their trace."""
