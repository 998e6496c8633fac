"""The commands of evs-bench, one file each."""
