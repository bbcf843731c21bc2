"""A linear problem -> its estimate: batch, recursive, with other gains; and the iteration around them."""
