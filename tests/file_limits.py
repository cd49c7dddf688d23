"""A limit on the size of files, under which writing fails as on a full disk."""

import resource
from contextlib import contextmanager


@contextmanager
def largest_file(num_bytes: int):
    """No file of this process may grow beyond `num_bytes`; Python ignores the signal, so writing raises."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
