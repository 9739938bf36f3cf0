"""Many runs: every combination of settings, recordings and seeds, on one machine or a Dask cluster."""
