"""The Earth under and around an observer: its rotation, sites on it, dates counted by it."""
