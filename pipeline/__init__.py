"""The whole library: clustering, the pattern store, archives and the jobs that write them."""
