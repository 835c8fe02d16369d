"""Many processes or machines: pure functions that Dask runs on workers, with the results of one machine, bit by bit."""
