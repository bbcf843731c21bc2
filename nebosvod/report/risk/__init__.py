"""The page of a risk of impact: probability, target planes, corridors, what is to blame."""
