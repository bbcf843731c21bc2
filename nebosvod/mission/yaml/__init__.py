"""The text of a mission: YAML with the line of everything, and what one telescope takes from another."""
