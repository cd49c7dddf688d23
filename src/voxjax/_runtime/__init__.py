"""What every stage runs on: kept programs, compiled kernels, memory, threads and the lengths of padded arrays.

This package is for those who write a stage or a kernel; users meet `voxjax.use_compilation_cache` alone. Start at
`placement` (the one question whether the host's form of an operation runs), then `tables` (how long arrays are padded)
and `programs` (what one process keeps for the next).
"""
