"""The command `voxjax`: arguments in, files and one exit code out.

Nothing here imports NumPy or JAX before the arguments are parsed, so that help is instant.
"""
