"""Built-in studies, and the missions that they vary."""
