"""What a run shows: the events of each point, its clock, a ripple of its light, and sums that views make of them."""
