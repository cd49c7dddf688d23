"""Rows of `python -m bench kernels`, by subject; each module has `rows(sizes) -> Iterator[KernelRow]`."""
