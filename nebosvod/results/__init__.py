"""What is left on disk: folders with a lock, a list and a manifest; summaries, tables, comparisons."""
