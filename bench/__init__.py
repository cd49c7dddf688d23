"""Benchmarks: `python -m bench NAME`; how they measure is said in `timing`."""
