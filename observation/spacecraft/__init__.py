"""Where a telescope is: each kind of orbit, table or file -> barycentric ICRF states."""
