"""Who measures a run's cells: this machine (`local`) or those behind a Dask scheduler (`dask`)."""
