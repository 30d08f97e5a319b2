"""Small dense linear algebra for kernels."""
