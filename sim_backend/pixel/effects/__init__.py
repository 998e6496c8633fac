"""Physical effects, one small file each."""
