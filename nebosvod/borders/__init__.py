"""Where the program meets the world: quantities of other libraries, files written whole, streams, shapes of JSON."""
