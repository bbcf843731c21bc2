"""An orbit with its covariance from anywhere: files of others, folders and missions of ours (reading only)."""
