"""What scripts and notebooks call: a function for each command, and answers that show themselves."""
