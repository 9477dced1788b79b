"""Tasks on threads, processes or a Dask cluster."""
