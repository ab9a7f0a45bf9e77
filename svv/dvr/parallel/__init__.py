"""A volume that is distributed over MPI's ranks, drawn as one."""
