"""The command `voxjax`: arguments in, files and one exit code out.

`main` runs one subcommand, each of which has a file of its own. Nothing here imports NumPy or JAX before the arguments
are parsed, so that help is instant.
"""
