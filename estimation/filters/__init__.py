"""The filters of the textbooks, for use by hand: Kalman, consider, two-stage, smoother, combined."""
