"""Summaries as dataclasses, a module for each command; those with a `Summary` are made from the JSON Schemas."""
