"""A file -> a mission, with every error at its line: rules, words of errors, files it names, built-in ones."""
