"""Many runs: tasks in worker processes, campaigns that go on where they stopped, verdicts on covariances."""
