"""Which measurement to make next: visits that could be made, and what each would bring."""
