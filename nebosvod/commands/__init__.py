"""One verb, one file: options, the call, words on the terminal."""
