"""What is uncertain about telescopes -> terms: what each error does to the measurements."""
