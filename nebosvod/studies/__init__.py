"""Many runs: campaigns and studies that go on where they stopped, verdicts on covariances."""
