"""What every stage runs on: kept programs, compiled kernels, memory, threads and the lengths of padded arrays.

This package is for those who write a stage or a kernel; users meet `voxjax.use_compilation_cache` alone. Start at
`tables` (how long an array is padded, and the one question whether arrays lie in the memory of the host).
"""
