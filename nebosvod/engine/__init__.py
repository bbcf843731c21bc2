"""Exposures and measured directions -> estimates and predictions; one truth or many."""
