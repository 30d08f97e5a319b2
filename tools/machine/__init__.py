"""The machine: processes, CPUs that stay awake, stalls of the host, loopback links."""
