"""Directions alone -> a first orbit."""
