"""The numbers of a model that fit a run best, how well they are known, and what is left over."""
