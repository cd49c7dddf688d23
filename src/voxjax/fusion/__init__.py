"""One map out of several whose poses are known: `fuse.fuse`, with the rules of `rules`."""
