"""Run tasks on other processes or machines with Dask."""
