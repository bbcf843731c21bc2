"""One engine for tasks that are numbered: processes on this machine, or workers of a dask cluster."""
