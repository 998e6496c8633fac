"""What a run must hold out: kills at the worst moments, and a night in which something fails every 20 minutes."""
