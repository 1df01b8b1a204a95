"""Select the terms of a law: the profiled problem, stepwise moves, and widths of priors."""
