"""What an estimate is worth to a mission: blame, requirements, curves, departures from linear, what cannot be told."""
