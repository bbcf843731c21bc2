"""What is known of an orbit when almost nothing is: range and range rate on a grid, the rest linear in each node."""
